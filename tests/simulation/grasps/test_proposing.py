from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bricks import brick, from_top
from graspcast.errors import InputError, MismatchError
from graspcast.pose.transforms import compose, exp
from graspcast.simulation.grasps.diversity import Spacing, hand_symmetries
from graspcast.simulation.grasps.proposals import OpenHand
from graspcast.simulation.grasps.proposing import APART_M, APART_RAD, ProposedGrasps, propose_grasps
from graspcast.simulation.grasps.ranking import Effort
from graspcast.simulation.grasps.table import read_grasps, write_grasps
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.objects.types import Grasp
from graspcast.simulation.trial.trial import TrialRunner
from jaws import write_jaws

FEW = Effort(candidates=12, first_errors=3, parents=1, variations=1, jitter=2, final=3)
TINY = Effort(candidates=8, first_errors=2, parents=1, variations=1, jitter=1, final=1)
ERRORS = exp(np.random.default_rng(3).standard_normal((30, 6)) * np.repeat([0.006, 0.08], 3))


@cache
def _found() -> ProposedGrasps:
    known = [Grasp(from_top(0.02), "box", "parallel", "top")]
    gripper = load_gripper("parallel")
    return propose_grasps(brick(), gripper, ERRORS, count=3, effort=FEW, known=known, workers=1)


@pytest.mark.slow
def test_the_best_come_first_and_all_hold_at_the_true_pose() -> None:
    found = _found()
    lows = [found.figures(k)["success_low"] for k in range(len(found.grasps))]
    assert lows == sorted(lows, reverse=True)
    names = [grasp.name for grasp in found.grasps]
    assert "top" in names
    others = [name for name in names if name != "top"]
    assert others == [f"g{k:02d}" for k in range(1, len(others) + 1)] and len(others) == 3
    runner = TrialRunner(brick(), load_gripper("parallel"))
    assert all(runner.run(np.eye(4), grasp).success for grasp in found.grasps)


@pytest.mark.slow
def test_they_are_different_from_one_another() -> None:
    gripper, thing = load_gripper("parallel"), brick()
    hand = OpenHand.of(TrialRunner(thing, gripper).scene, gripper)
    spacing = Spacing(APART_M, APART_RAD, np.eye(4)[None], hand_symmetries(hand))
    poses = np.array([g.obj_T_grasp for g in _found().grasps if g.name != "top"])
    for k, pose in enumerate(poses):
        assert np.all(spacing.apart(pose, np.delete(poses, k, axis=0)) >= 1.0)
    # None comes from below the table.
    assert np.all(compose(thing.sim_T_ref, poses)[:, 2, 2] < 0.25)


@pytest.mark.slow
def test_the_number_of_threads_makes_no_difference() -> None:
    gripper = load_gripper("parallel")
    one, two = (
        propose_grasps(brick(), gripper, ERRORS, count=2, effort=TINY, workers=workers)
        for workers in (1, 2)
    )
    for a, b in zip(one.grasps, two.grasps, strict=True):
        assert a.name == b.name and np.array_equal(a.obj_T_grasp, b.obj_T_grasp)
    assert [r.success for r in one.ranked] == [r.success for r in two.ranked]


def test_figures_are_written_and_read_again(tmp_path: Path) -> None:
    found = _found()
    write_grasps(tmp_path / "grasps.toml", found.as_references("of a test", friction=0.8))
    read = read_grasps(tmp_path / "grasps.toml").of("box", "parallel")
    assert [r.grasp.name for r in read] == [g.name for g in found.grasps]
    figures = read[0].agreement
    assert figures["success_under_error"] == pytest.approx(found.ranked[0].rate, abs=1e-4)
    assert figures["trials"] == 24 and figures["perfect_of"] == 2 and figures["seed"] == 0
    assert figures["errors"] == "of a test" and figures["candidates"] == found.tried
    assert figures["trials_in_all"] == found.trials
    assert figures["survived_rms_x_mm"] > 1 and figures["survived_rms_about_z_deg"] > 1


@pytest.mark.slow
def test_a_gripper_of_one_s_own(tmp_path: Path) -> None:
    gripper = load_gripper(write_jaws(tmp_path))
    found = propose_grasps(brick(), gripper, ERRORS, count=2, effort=TINY, workers=1)
    assert found.ranked[0].rate > 0.5


@pytest.mark.slow
def test_a_gripper_of_the_menagerie() -> None:
    from graspcast.errors import GraspcastError

    try:
        gripper = load_gripper("robotiq_2f85")
        found = propose_grasps(brick(), gripper, ERRORS, count=3, effort=FEW)
    except GraspcastError as error:
        pytest.skip(str(error))
    assert found.ranked[0].rate > 0.5


@pytest.mark.ill_typed
def test_known_grasps_are_of_the_pair_and_errors_have_their_shape() -> None:
    hand = load_gripper("parallel")
    other = Grasp(np.eye(4), "mug-1", "parallel")
    with pytest.raises(MismatchError, match="a known grasp is of 'mug-1' by 'parallel', not of"):
        propose_grasps(brick(), hand, np.eye(4)[None], known=[other])
    with pytest.raises(InputError, match=r"the shape \(4, 4\), not \(n, 4, 4\)"):
        propose_grasps(brick(), hand, np.eye(4))
