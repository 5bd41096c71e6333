from __future__ import annotations

import math

import numpy as np
import pytest

from bricks import brick, from_top
from graspcast.pose.transforms import compose
from graspcast.simulation.grasps.clearance import clear_approach
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.trial.trial import TrialRunner


def test_the_palm_meets_the_top_where_it_is() -> None:
    gripper, thing = load_gripper("parallel"), brick()
    scene = TrialRunner(thing, gripper).scene
    grasp = compose(thing.sim_T_ref, from_top(0.0))
    found = clear_approach(scene, gripper, grasp, 0.06)
    # The palm is 37.4 mm behind the tool centre point, which is at the top.
    assert found.hit == "object"
    assert 0.0374 - 0.005 < found.reaches_m <= 0.0374
    assert clear_approach(scene, gripper, grasp, 0.02) == (pytest.approx(0.02), None)


def test_fingers_that_come_down_on_the_object_or_beside_it() -> None:
    gripper, thing = load_gripper("parallel"), brick()
    scene = TrialRunner(thing, gripper).scene
    above = compose(thing.sim_T_ref, from_top(0.0))
    above[0, 3] += 0.03
    found = clear_approach(scene, gripper, above, 0.03)
    assert found.hit == "object" and found.reaches_m < 0.0
    beside = above.copy()
    beside[1, 3] += 0.3
    found = clear_approach(scene, gripper, beside, 0.1)
    assert found.hit == "table" and found.reaches_m == pytest.approx(0.07 - 0.0085, abs=0.006)


def test_a_hand_that_starts_in_the_table() -> None:
    gripper, thing = load_gripper("parallel"), brick()
    scene = TrialRunner(thing, gripper).scene
    below = np.eye(4)
    below[:3, 3] = 0.4, 0.0, -0.3
    assert clear_approach(scene, gripper, below, 0.0) == (-math.inf, "table")
