"""First looks in batches are what episodes say of each."""

from __future__ import annotations

import numpy as np
import pytest

from episode_world import FOUND, World, new_world
from graspcast.errors import GraspcastError
from graspcast.runtime.frame import Estimate, Frame
from graspcast.runtime.judging import Judge
from looked_at import CAMERAS, NAMES


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return new_world(tmp_path_factory.mktemp("world"))


def frame(i: int, counts: dict[str, int], *, known: bool = True) -> Frame:
    """Instances of d-1 and d-2 in turn: so many by each estimator, all at places of their own."""
    estimates = {}
    for name, count in counts.items():
        some = []
        for j in range(count):
            pose = FOUND[name][i, j % 2].copy()
            pose[:3, 3] += [0.4 * (j // 2), 0.0, 0.0]
            some.append(Estimate(f"d-{j % 2 + 1}", pose, 0.9 - 0.01 * j))
        estimates[name] = some
    return Frame(estimates, CAMERAS[i] if known else None)


def frames() -> list[Frame]:
    """Frames with missing estimators, the principal too, several instances, and none."""
    every = dict.fromkeys(NAMES, 2)
    odd = Frame({name: [Estimate("d-1", np.eye(4) * np.nan)] for name in NAMES}, CAMERAS[0])
    strange = Frame({name: [Estimate("d-9", FOUND[name][0, 0])] for name in NAMES})
    mixed = Frame(
        {
            "a": [Estimate("d-1", FOUND["a"][0, 0]), Estimate("d-9", FOUND["a"][0, 1])],
            "b": [Estimate("d-9", FOUND["b"][0, 1])],
            "c": [Estimate("d-9", FOUND["c"][0, 1])],
        }
    )
    return [
        mixed,
        frame(0, every),
        frame(1, every, known=False),
        frame(2, {"a": 2, "b": 1}),
        frame(3, {"b": 2, "c": 2}),
        frame(4, {"a": 1, "b": 2, "c": 2}),
        frame(0, dict.fromkeys(NAMES, 7)),
        Frame({}),
        odd,
        strange,
    ]


@pytest.mark.parametrize("guide", [None, "fused", "best", "b"])
@pytest.mark.parametrize("views", [True, False])
def test_a_batch_says_what_episodes_say(world: World, guide: str | None, views: bool) -> None:
    forecaster = world.forecaster if views else world.without_views
    judge = Judge(forecaster, world.models, threshold=0.7, guide=guide, max_looks=3)
    for one, found in zip(frames(), judge.first_looks(frames(), "d"), strict=True):
        assert not isinstance(found, GraspcastError)
        expected = judge.look(judge.episodes("d"), one)
        assert [str(v) for v in found] == [str(v) for v in expected]
        assert [v.verdict.reason for v in found] == [v.verdict.reason for v in expected]
        assert [v.probability for v in found] == [v.probability for v in expected]
        assert [(v.instance, v.object_name, v.guide, v.views, v.looks) for v in found] == [
            (v.instance, v.object_name, v.guide, v.views, v.looks) for v in expected
        ]
        for mine, its in zip(found, expected, strict=True):
            np.testing.assert_array_equal(mine.cam_T_obj, its.cam_T_obj)
            assert (mine.world_T_obj is None) == (its.world_T_obj is None)
            assert (mine.look is None) == (its.look is None)
            if mine.look is not None and its.look is not None:
                np.testing.assert_allclose(mine.look.direction, its.look.direction, atol=1e-6)


def test_a_frame_with_one_estimator_under_two_names_is_refused_alone(world: World) -> None:
    usual = frame(0, dict.fromkeys(NAMES, 6))
    copied = Frame({**usual.estimates, "b": usual.estimates["a"]}, usual.world_T_cam)
    judge = Judge(world.forecaster, world.models, threshold=0.7)
    first, second, third = judge.first_looks([usual, copied, usual], "d")
    assert isinstance(second, GraspcastError)
    with pytest.raises(type(second)) as error:
        judge.look(judge.episodes("d"), copied)
    assert str(error.value) == str(second)
    assert isinstance(first, list) and isinstance(third, list) and len(first) == 6
