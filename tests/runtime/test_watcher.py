"""Decisions on frames."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from episode_world import FOUND, World, new_world
from graspcast.attempt_log.log import AttemptLog
from graspcast.errors import (
    GraspcastError,
    InputError,
    MismatchError,
    UnknownEpisodeError,
    UnknownNameError,
)
from graspcast.guarantees.certify import certify
from graspcast.pose.transforms import compose
from graspcast.runtime.answer import Answer
from graspcast.runtime.frame import Estimate, Frame
from graspcast.runtime.watcher import Watcher
from graspcast.simulation.grasps.table import GraspTable, ReferenceGrasp
from graspcast.simulation.objects.types import Grasp
from looked_at import CAMERAS, NAMES


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return new_world(tmp_path_factory.mktemp("world"))


@pytest.fixture(scope="module")
def watcher(world: World) -> Watcher:
    return Watcher(world.forecaster, models=world.models, threshold=0.7)


def frame(i: int, *, names: tuple[str, ...] = NAMES, known: bool = True) -> Frame:
    estimates = {
        name: [Estimate(f"d-{o + 1}", FOUND[name][i, o], 0.9) for o in range(2)] for name in names
    }
    return Frame(estimates, CAMERAS[i] if known else None)


def test_a_frame_is_judged_as_episodes_judge_it(world: World, watcher: Watcher) -> None:
    from episode_world import results

    episodes = world.episodes()
    answer: Answer | None = None
    for i in range(3):
        answer = watcher.judge(frame(i), None if answer is None else answer.episode)
        expected = episodes.look(results(i), CAMERAS[i])
        assert answer.look == i + 1
        assert [d.instance for d in answer] == [v.instance for v in expected]
        assert [d.probability for d in answer] == [v.probability for v in expected]
        assert [d.action for d in answer] == [str(v) for v in expected]
        assert [d.reason for d in answer] == [v.verdict.reason for v in expected]
        for decision, verdict in zip(answer, expected, strict=True):
            np.testing.assert_array_equal(decision.cam_T_obj, verdict.cam_T_obj)
            assert decision.world_T_obj is not None
            wanted = compose(CAMERAS[i], decision.cam_T_obj)
            np.testing.assert_allclose(decision.world_T_obj, wanted, atol=1e-12)


def test_a_batch_of_first_looks_is_judged_as_each_alone(watcher: Watcher) -> None:
    frames = [frame(0), frame(1, known=False), frame(2, names=NAMES[:2]), frame(3)]
    together = watcher.judge_all(frames)
    for answer, each in zip(together, frames, strict=True):
        alone = watcher.judge(each)
        assert isinstance(answer, Answer)
        assert answer.episode != alone.episode
        for one, other in zip(answer, alone, strict=True):
            mine, its = one.as_dict(), other.as_dict()
            assert mine.pop("id") != its.pop("id")
            assert mine == its


def test_an_odd_frame_in_a_batch_has_its_error_and_the_others_their_answers(
    watcher: Watcher,
) -> None:
    odd = Frame({"another": [Estimate("d-1", FOUND["a"][0, 0])]})
    first, error, last = watcher.judge_all([frame(0), odd, frame(1)])
    assert isinstance(first, Answer) and isinstance(last, Answer)
    assert isinstance(error, UnknownNameError)
    assert "'another'" in str(error) and "a, b, c" in str(error)


def test_an_odd_object_leaves_the_verdicts_on_the_others(watcher: Watcher) -> None:
    wrong = np.full((4, 4), np.nan)
    usual = frame(0)
    estimates = {
        name: [given[0], Estimate("d-2", wrong), Estimate("other-7", FOUND[name][0, 1])]
        for name, given in usual.estimates.items()
    }
    answer = watcher.judge(Frame(estimates, CAMERAS[0]))
    said = {d.object_name: d for d in answer}
    assert said["d-1"].probability == watcher.judge(usual).decisions[0].probability
    assert said["d-2"].action == said["other-7"].action == "abstain"
    assert "not finite" in said["d-2"].reason and said["d-2"].instance == -1
    assert "not trained for other-7" in said["other-7"].reason


def test_an_episode_that_is_not_known_says_why(world: World) -> None:
    watcher = Watcher(world.forecaster, models=world.models, max_episodes=2)
    ids = [watcher.judge(frame(0)).episode for _ in range(3)]
    with pytest.raises(UnknownEpisodeError, match="made room for others, since 2 are kept"):
        watcher.judge(frame(1), ids[0])
    watcher.forget(ids[1])
    with pytest.raises(UnknownEpisodeError, match="was forgotten"):
        watcher.judge(frame(1), ids[1])
    with pytest.raises(UnknownEpisodeError, match="nothing is not known here"):
        watcher.judge(frame(1), "nothing")


def test_an_episode_expires(world: World) -> None:
    watcher = Watcher(world.forecaster, models=world.models, episode_ttl_s=0.001)
    episode = watcher.judge(frame(0)).episode
    import time

    time.sleep(0.01)
    with pytest.raises(UnknownEpisodeError, match=r"no look for 0\.001 s"):
        watcher.judge(frame(1), episode)


def test_a_look_that_fails_does_not_count(watcher: Watcher) -> None:
    first = frame(0)
    timed = Frame(first.estimates, first.world_T_cam, time_s=5.0)
    answer = watcher.judge(timed)
    with pytest.raises(InputError, match="times should increase"):
        watcher.judge(Frame(first.estimates, first.world_T_cam, time_s=4.0), answer.episode)
    assert watcher.judge(frame(1), answer.episode).look == 2


def test_a_model_file_is_loaded(world: World, tmp_path: Path) -> None:
    world.forecaster.save(tmp_path / "model.npz")
    watcher = Watcher.load(tmp_path / "model.npz", models=world.models, threshold=0.7)
    watcher.warm_up()
    assert "a with b, c" in repr(watcher)
    assert len(watcher.judge(frame(0))) == 2


def test_decisions_are_in_the_log_before_an_answer_and_outcomes_follow(
    world: World, tmp_path: Path
) -> None:
    with AttemptLog.open(tmp_path / "log.db") as log:
        watcher = Watcher(world.forecaster, log=log, threshold=0.1, source="test")
        answer = watcher.judge(frame(0))
        watcher.judge(frame(1), answer.episode)
        watcher.judge_all([frame(2), frame(3)])
        assert log.decisions()["id"].to_list()[:2] == [d.id for d in answer]
        assert len(log.decisions()) == 8 and len(log.frames()) == 4
        watcher.outcome(answer.attempts[0].id, True)
        assert log.outcomes()["success"].to_list() == [True]
        with pytest.raises(InputError, match="no decision"):
            watcher.outcome("f" * 32, True)


def test_outcomes_need_a_log(watcher: Watcher) -> None:
    with pytest.raises(InputError, match="this watcher has none"):
        watcher.outcome("f" * 32, True)


def test_what_cannot_be_logged_is_not_answered(world: World, tmp_path: Path) -> None:
    log = AttemptLog.open(tmp_path / "log.db")
    watcher = Watcher(world.forecaster, log=log)
    answer = watcher.judge(frame(0))
    log.close()
    with pytest.raises(GraspcastError):
        watcher.judge(frame(0))
    with pytest.raises(GraspcastError):
        watcher.judge(frame(1), answer.episode)
    assert "1 episode)" in repr(watcher)


def test_the_gripper_goes_where_the_grasp_is_on_the_object(world: World) -> None:
    hold = compose(CAMERAS[0], np.eye(4))
    hold[:3, 3] = [0.0, 0.01, 0.02]
    table = GraspTable(
        [ReferenceGrasp(Grasp(obj_T_grasp=hold, object="d-1", gripper="parallel"), "test")]
    )
    forecaster = world.forecaster.with_objects(world.models, table)
    answer = Watcher(forecaster, threshold=0.01).judge(frame(0))
    first, second = answer
    assert first.attempt and second.attempt
    assert first.cam_T_obj is not None and first.cam_T_grasp is not None
    assert first.world_T_grasp is not None and first.grasp == "reference"
    np.testing.assert_allclose(first.cam_T_grasp, first.cam_T_obj @ hold, atol=1e-12)
    np.testing.assert_allclose(first.world_T_grasp, CAMERAS[0] @ first.cam_T_grasp, atol=1e-12)
    assert second.cam_T_grasp is None
    assert any("grasp reference of d-2 by parallel" in note for note in answer.notes)


@pytest.mark.slow
def test_many_threads_ask_at_once(world: World) -> None:
    watcher = Watcher(world.forecaster, threshold=0.7)
    watcher.warm_up()
    expected = [
        [d.probability for d in each] for each in watcher.judge_all([frame(i) for i in range(4)])
    ]
    shared = watcher.judge(frame(0)).episode
    order: list[int] = []

    def ask(number: int) -> list[float | None]:
        if number % 8 == 0:
            order.append(watcher.judge(frame(number % 3), shared).look)
        return [d.probability for d in watcher.judge(frame(number % 4))]

    with ThreadPoolExecutor(16) as pool:
        found = list(pool.map(ask, range(96)))
    assert found == [expected[i % 4] for i in range(96)]
    assert sorted(order) == list(range(2, 14))


def test_a_whole_unknown_object_beside_an_incomplete_known_one(watcher: Watcher) -> None:
    estimates = {name: [Estimate("d-9", FOUND[name][0, 1])] for name in NAMES}
    estimates["a"].append(Estimate("d-1", FOUND["a"][0, 0]))
    said = {d.object_name: d.reason for d in watcher.judge(Frame(estimates))}
    assert said["d-9"].startswith("the model was not trained for d-9")
    assert said["d-1"].startswith("no estimate by b, c")


def test_an_object_of_placeholders_alone_is_in_the_notes(watcher: Watcher) -> None:
    answer = watcher.judge(Frame({name: [Estimate("d-1", np.eye(4))] for name in NAMES}))
    assert not answer.decisions
    assert sum("placeholders" in note and "d-1" in note for note in answer.notes) == len(NAMES)


def test_estimates_given_twice_are_decided_once(watcher: Watcher) -> None:
    once = {name: [Estimate("d-1", FOUND[name][0, 0])] for name in NAMES}
    expected = watcher.judge(Frame(once))
    answer = watcher.judge(Frame({name: given * 2 for name, given in once.items()}))
    (decision,) = answer.decisions
    assert decision.probability == expected.decisions[0].probability
    assert sum("is judged once: d-1" in note for note in answer.notes) == len(NAMES)


def test_numbers_near_the_largest_are_no_pose_and_no_warning(watcher: Watcher) -> None:
    large = np.eye(4)
    large[0, 1] = large[2, 3] = 1e300
    (decision,) = watcher.judge(Frame({"a": [Estimate("d-1", large)]}))
    assert decision.action == "abstain" and decision.instance == -1


def within_reach(i: int, reachable: object) -> Frame:
    usual = frame(i)
    return Frame(usual.estimates, CAMERAS[i], reachable=reachable)  # type: ignore[arg-type]


def test_a_grasp_is_chosen_among_those_within_reach(world: World) -> None:
    watcher = Watcher(world.forecaster, models=world.models, threshold=0.0, max_looks=1)
    free = watcher.judge(frame(0))
    assert [d.grasp for d in free] == ["reference", "reference"]
    assert [d.probability for d in watcher.judge(within_reach(0, ["reference"]))] == [
        d.probability for d in free
    ]
    for answer in (
        watcher.judge(within_reach(0, [])),
        watcher.judge_all([within_reach(0, set())])[0],
    ):
        assert isinstance(answer, Answer)
        assert [d.action for d in answer] == ["abstain", "abstain"]
        assert all("no grasp is reachable" in d.reason for d in answer)
    some = watcher.judge_all([frame(1), within_reach(0, {"d-1": []})])[1]
    assert isinstance(some, Answer)
    said = {d.object_name: d for d in some}
    assert said["d-1"].action == "abstain" and said["d-2"].action == "attempt"
    with pytest.raises(UnknownNameError, match="unknown reachable grasp 'side'"):
        watcher.judge(within_reach(0, ["side"]))


@pytest.mark.ill_typed
def test_a_certificate_of_all_grasps_serves_no_choice_among_some(world: World) -> None:
    forecaster = world.forecaster
    found = certify(np.full(40, 0.95), np.ones(40, bool), np.arange(40), rate=0.9, confidence=0.9)
    stated = {"model": forecaster.card.digest, "ood_alpha": 0.01}
    certificate = replace(found, policy=None, provenance=stated)
    for given in (certificate, [certificate]):
        watcher = Watcher(forecaster, models=world.models, max_looks=1, certificate=given)
        assert watcher.judge(frame(0)).look == 1
        with pytest.raises(MismatchError, match="guarantees nothing where only some are reachable"):
            watcher.judge(within_reach(0, ["reference"]))
    with pytest.raises(InputError, match="certificate should be a Certificate, or a list"):
        Watcher(forecaster, models=world.models, certificate=["c.json"])  # type: ignore[list-item]


def test_episodes_are_counted_and_forgotten_once(world: World) -> None:
    watcher = Watcher(world.forecaster, models=world.models)
    episode = watcher.judge(frame(0)).episode
    assert watcher.episodes == 1
    watcher.forget(episode)
    assert watcher.episodes == 0
    with pytest.raises(UnknownEpisodeError, match="was forgotten"):
        watcher.forget(episode)
