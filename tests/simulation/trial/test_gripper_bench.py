"""The bench on which grippers are tried."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.simulation.grippers import FrankaHand
from graspcast.simulation.trial.gripper_bench import ParkedHand, grasp_of_column, standing_column
from graspcast.simulation.trial.scene import build_scene
from graspcast.simulation.trial.settings import TrialSettings


def test_a_column_is_three_times_as_high_as_wide_and_as_deep_as_asked() -> None:
    np.testing.assert_allclose(np.ptp(standing_column(0.04).vertices, axis=0), [0.04, 0.04, 0.12])
    column = standing_column(0.04, depth_m=0.1, mass_kg=0.2)
    np.testing.assert_allclose(np.ptp(column.vertices, axis=0), [0.04, 0.1, 0.12])
    # A cuboid's moment about x.
    assert column.inertia[0, 0] == pytest.approx(0.2 / 12 * (0.1**2 + 0.12**2))
    assert column.sim_T_ref[2, 3] == pytest.approx(0.06)


def test_the_grasp_is_half_a_width_below_the_top() -> None:
    grasp = grasp_of_column(FrankaHand(), 0.04)
    assert grasp.obj_T_grasp[2, 3] == pytest.approx(0.06 - 0.02)
    assert grasp_of_column(FrankaHand(), 0.04, 0.1).obj_T_grasp[2, 3] == pytest.approx(0.14)


def test_a_parked_hand_closes_from_open_to_closed() -> None:
    hand = FrankaHand()
    parked = ParkedHand(build_scene(standing_column(0.04), hand, TrialSettings()))
    parked.command(hand.closing.open, 0.5)
    postures = parked.close(hand.closing, 1.0)
    fingers = np.array(postures)[:, parked.scene.model.jnt_qposadr[parked.scene.hand_joints]]
    np.testing.assert_allclose(fingers[0], hand.stroke_m, atol=1e-4)
    np.testing.assert_allclose(fingers[-1], 0.0, atol=1e-3)
    assert (np.diff(fingers, axis=0) < 1e-3).all()
    # The object, far below, is untouched.
    assert not parked.scene.contacts().hand_object
