"""Several looks at one object."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from episode_world import FOUND, POSES, World, new_world, poses, results
from graspcast import Episode, Episodes, NextLook
from graspcast.errors import GraspcastError, InputError, MismatchError, UnknownNameError
from graspcast.pose.transforms import compose, invert, transform
from looked_at import CAMERAS, NAMES
from static_scenes import scattered
from test_misuse import ODD


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return new_world(tmp_path_factory.mktemp("world"))


def test_it_looks_again_until_it_is_sure_and_grasps_by_the_fused_pose(world: World) -> None:
    episode = world.episode(guide="fused")
    first = episode.look(poses(0), CAMERAS[0])
    assert (str(first), first.views, first.looks) == ("look again", 1, 1)
    assert isinstance(first.look, NextLook)
    assert first.look.expected_probability is not None
    assert first.look.direction_world is not None
    np.testing.assert_allclose(
        first.look.direction_world, CAMERAS[0][:3, :3] @ first.look.direction
    )
    assert "one view" in first.reason
    second = episode.look(poses(1), CAMERAS[1])
    assert (str(second), second.guide, second.views, second.looks) == ("attempt", "fused", 2, 2)
    assert second.attempt
    assert second.probability is not None
    assert second.probability >= 0.7
    assert "2 views" in second.reason
    assert second.cam_T_obj is not None
    assert second.world_T_obj is not None
    np.testing.assert_allclose(second.world_T_obj, CAMERAS[1] @ second.cam_T_obj)
    off = np.linalg.norm(second.cam_T_obj[:3, 3] - POSES[1, 1, :3, 3])
    assert off < np.linalg.norm(FOUND["a"][1, 1, :3, 3] - POSES[1, 1, :3, 3])
    assert repr(episode) == "Episode(d-2, 2 looks)"


def test_one_look_is_the_verdict_of_a_single_view(world: World) -> None:
    for guide in NAMES:
        one = world.episode(guide=guide, max_looks=1).look(poses(2), CAMERAS[2])
        forecaster = world.forecaster.guided_by(guide)
        same = forecaster.predict(poses(2), "d-2", threshold=0.7, models=world.models)
        assert (one.probability, one.attempt, one.look) == (same.probability, same.attempt, None)
        assert one.guide == guide
        assert one.cam_T_obj is not None
        np.testing.assert_array_equal(one.cam_T_obj, poses(2)[guide])


def test_it_stops_asking_after_the_last_look(world: World) -> None:
    episode = world.episode(threshold=1.0, max_looks=2)
    assert str(episode.look(poses(0), CAMERAS[0])) == "look again"
    assert str(episode.look(poses(1), CAMERAS[1])) == "abstain"
    assert str(episode.look(poses(2), CAMERAS[2])) == "abstain"


def test_a_look_without_an_estimate(world: World) -> None:
    episode = world.episode()
    nothing = episode.look({}, CAMERAS[0])
    assert (str(nothing), nothing.guide, nothing.cam_T_obj) == ("abstain", None, None)
    assert nothing.reason == "no estimate by a, b, c in this look"
    assert nothing.probability is None
    episode.look(poses(1), CAMERAS[1])
    episode = world.episode()
    episode.look(poses(1), CAMERAS[1])
    behind = poses(2)["b"] @ np.diag([1.0, 1, 1, 1])
    behind[2, 3] *= -1
    lost = episode.look({"a": None, "b": behind}, CAMERAS[2])
    assert str(lost) == "look again"
    assert lost.look is not None
    assert "b (its pose lies behind the camera" in lost.reason
    # From a side from which it has not been seen, as from the world.
    position = (CAMERAS[1] @ poses(1)["a"])[:3, 3]
    for camera in CAMERAS[1:3]:
        towards = (camera[:3, 3] - position) / np.linalg.norm(camera[:3, 3] - position)
        assert lost.look.direction_world is not None
        assert np.arccos(towards @ lost.look.direction_world) > np.deg2rad(11)
    found = episode.look(poses(3), CAMERAS[3])
    assert (found.views, found.looks) == (2, 3)


def test_a_missing_estimator_is_not_filled_in(world: World) -> None:
    one = world.episode(max_looks=1).look({"a": poses(0)["a"]}, CAMERAS[0])
    assert (str(one), one.probability) == ("abstain", None)
    assert "no estimate by b, c" in one.reason
    episode = world.episode(guide="fused")
    episode.look({"a": poses(0)["a"]}, CAMERAS[0])
    assert episode.look({"b": poses(1)["b"]}, CAMERAS[1]).views == 2


def test_looks_from_the_same_place_count_as_one(world: World) -> None:
    episode = world.episode()
    episode.look(poses(0), CAMERAS[0])
    again = episode.look(
        {n: scattered(POSES, 5 + k)[0, 1] for k, n in enumerate(NAMES)}, CAMERAS[0]
    )
    assert again.views == 1
    assert "parallax too small" in again.reason


def test_without_camera_poses_the_last_look_counts(world: World) -> None:
    episode = world.episode()
    for i in range(2):
        verdict = episode.look(poses(i))
        assert (verdict.views, verdict.world_T_obj) == (1, None)
    if verdict.look is not None:
        assert verdict.look.direction_world is None


def test_a_model_without_views_answers_from_the_last_look(world: World) -> None:
    episode = Episode(world.without_views, "d-2", models=world.models, threshold=0.7)
    said = "the model was trained without views: the last look alone counts"
    assert said not in episode.look(poses(0), CAMERAS[0]).notes
    verdict = episode.look(poses(1), CAMERAS[1])
    assert verdict.notes.count(said) == 1
    fused = Episode(world.without_views, "d-2", models=world.models, guide="fused")
    assert said in fused.look(poses(0), CAMERAS[0]).notes
    assert said not in world.episode(guide="fused").look(poses(0), CAMERAS[0]).notes
    assert (verdict.views, verdict.look) == (1, None)
    assert "one view" in verdict.reason
    single = world.without_views.predict(poses(1), "d-2", threshold=0.7, models=world.models)
    assert verdict.probability == single.probability


def test_a_refused_look_does_not_count(world: World) -> None:
    episode = world.episode()
    episode.look(poses(0), CAMERAS[0], time_s=5.0)
    wrong = transform(np.eye(3), np.array([0.4, 0.3, 0.2]))
    with pytest.raises(InputError, match="times should increase"):
        episode.look(poses(1), CAMERAS[1], time_s=4.0)
    with pytest.raises(InputError, match="scaled"):
        episode.look(poses(1), np.diag([2.0, 2, 2, 1]) @ CAMERAS[1])
    with pytest.raises(InputError, match="K has focal lengths"):
        episode.look(poses(1), CAMERAS[1], np.eye(3))
    with pytest.raises(UnknownNameError, match="'gdrnp'"):
        episode.look({"gdrnp": poses(1)["a"]}, CAMERAS[1])
    assert episode.look(poses(1), CAMERAS[1], time_s=6.0).views == 2
    other = world.episode()
    other.look(poses(0), invert(compose(wrong, CAMERAS[0])))
    with pytest.raises(MismatchError, match="read in the other direction"):
        other.look(poses(1), invert(compose(wrong, CAMERAS[1])))


def test_a_moved_object_is_not_attempted_until_forgotten(world: World) -> None:
    episode = world.episode(guide="fused", threshold=0.1)
    for i in range(2):
        episode.look(poses(i), CAMERAS[i])
    moved = {name: pose.copy() for name, pose in poses(2).items()}
    for pose in moved.values():
        pose[:3, 3] += [0.1, 0.02, 0.0]
    verdict = episode.look(moved, CAMERAS[2])
    assert not verdict.attempt
    assert "moved" in verdict.reason
    episode.forget()
    assert episode.look(moved, CAMERAS[2]).looks == 1


def test_threads(world: World) -> None:
    def whole(_: int) -> list[float | None]:
        episode = world.episode(guide="fused")
        return [episode.look(poses(i), CAMERAS[i]).probability for i in range(3)]

    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(whole, range(16)))
    assert all(one == found[0] for one in found)
    shared = world.episode(guide="fused", max_looks=50)
    with ThreadPoolExecutor(8) as pool:
        looks = list(pool.map(lambda i: shared.look(poses(i % 5), CAMERAS[i % 5]), range(16)))
    assert sorted(v.looks for v in looks) == list(range(1, 17))


@pytest.mark.ill_typed
def test_what_an_episode_cannot_be_made_of(world: World) -> None:
    with pytest.raises(MismatchError, match="not trained for d-9"):
        Episode(world.forecaster, "d-9")
    with pytest.raises(UnknownNameError, match="'z'"):
        world.episode(guide="z")
    with pytest.raises(InputError, match="probability between 0 and 1"):
        world.episode(threshold=2.0)
    with pytest.raises(InputError, match="whole numbers"):
        world.episodes(max_looks=2.5)


@pytest.mark.ill_typed
@pytest.mark.parametrize("odd", ODD, ids=lambda x: f"{type(x).__name__} {str(x)[:12]}")
def test_whatever_is_given_the_answer_is_a_verdict_or_an_error(odd: Any, world: World) -> None:
    calls = [
        lambda: world.episode().look(odd, CAMERAS[0]),
        lambda: world.episode().look({**poses(0), "b": odd}, CAMERAS[0]),
        lambda: world.episode().look(poses(0), odd),
        lambda: world.episode().look(poses(0), CAMERAS[0], odd),
        lambda: world.episode().look(poses(0), CAMERAS[0], time_s=odd),
        lambda: world.episodes().look(odd, CAMERAS[0]),
        lambda: world.episodes().look({"a": odd}, CAMERAS[0]),
        lambda: Episode(odd, "d-2"),
        lambda: Episode(world.forecaster, odd),
        lambda: Episodes(world.forecaster, odd).look(results(0), CAMERAS[0]),
    ]
    names = ("models", "threshold", "guide", "max_looks", "max_views", "min_gain", "noise")
    calls += [
        lambda name=name: world.episode(**{name: odd}).look(poses(0), CAMERAS[0])  # type: ignore[misc]
        for name in (*names, "ood_alpha", "guarantee")
    ]
    for call in calls:
        try:
            call()
        except GraspcastError as error:
            assert len(str(error)) > 10
