"""Bodies of trials as meshes: where they are, how large, and the open hand."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from graspcast.pose.transforms import invert, transform_points
from graspcast.rendering.trials.bodies import TrialBodies, open_hand, rest_joints
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.objects.types import Primitive
from graspcast.simulation.trial.recording import Recording
from graspcast.simulation.trial.trial import TrialRunner


def test_the_object_is_where_the_trial_had_it(runner: TrialRunner, held: Recording) -> None:
    seen = TrialBodies(runner.grasp_object, runner.gripper)
    for state in (held.states[0], held.states[-1]):
        at = transform_points(seen.poses(state)["object"], seen.bodies["object"].vertices)
        local = transform_points(invert(state.sim_T_obj), at)
        (piece,) = runner.grasp_object.pieces
        assert isinstance(piece, Primitive)
        half = np.array(piece.size)
        assert_allclose(local.min(axis=0), piece.obj_T_geom[:3, 3] - half, atol=1e-6)
        assert_allclose(local.max(axis=0), piece.obj_T_geom[:3, 3] + half, atol=1e-6)


def test_the_fingers_close_on_what_they_hold(runner: TrialRunner, held: Recording) -> None:
    seen = TrialBodies(runner.grasp_object, runner.gripper)

    def gap(state_number: int) -> float:
        poses = seen.poses(held.states[state_number])
        sides = [poses[f"hand/{side}_finger"][:3, 3] for side in ("left", "right")]
        return float(np.linalg.norm(sides[0] - sides[1]))

    assert gap(-1) < gap(0)
    assert all(name.startswith("hand/") for name in set(seen.bodies) - {"object", "estimate"})


@pytest.mark.parametrize("name", ["parallel", "underactuated"])
def test_the_open_hand_reaches_from_its_base_to_its_tip(name: str) -> None:
    gripper = load_gripper(name)
    hand = open_hand(gripper)
    tip = gripper.base_T_tcp
    points = (hand.vertices - tip[:3, 3]) @ tip[:3, :3]
    assert np.ptp(points[:, 0]) >= gripper.max_opening_m
    # The tool centre point is between the fingertips, so parts of the hand are beyond it.
    assert points[:, 2].max() > 0 > points[:, 2].min()
    assert hand.faces.max() < len(hand.vertices) == len(hand.colours)


def test_the_joints_at_rest_are_a_copy(runner: TrialRunner) -> None:
    joints = rest_joints(runner)
    joints[:] = 9.0
    assert not np.allclose(rest_joints(runner), 9.0)
