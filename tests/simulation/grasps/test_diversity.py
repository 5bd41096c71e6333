from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bricks import brick, from_top
from graspcast.pose.transforms import rotation_from_vector, transform
from graspcast.simulation.grasps.diversity import Spacing, hand_symmetries, shape_symmetries
from graspcast.simulation.grasps.proposals import OpenHand
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.trial.trial import TrialRunner

ONE = np.eye(4)[None]
HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])


def _moved(*, x: float = 0.0, turn: float = 0.0) -> np.ndarray:
    step = transform(rotation_from_vector(np.array([0.0, 0.0, turn])), np.array([x, 0.0, 0.0]))
    return from_top(0.02) @ step


def test_grasps_are_different_if_far_away_or_turned() -> None:
    spacing = Spacing(0.01, np.deg2rad(20), ONE, ONE)
    others = np.array([_moved(x=0.004), _moved(x=0.012), _moved(turn=0.2), _moved(turn=0.5)])
    assert (spacing.apart(from_top(0.02), others) >= 1).tolist() == [False, True, False, True]
    assert spacing.spread(np.array([from_top(0.02), *others]), 5) == [0, 2, 4]
    assert spacing.spread(np.array([from_top(0.02), *others]), 2) == [0, 2]
    assert spacing.spread(others[[0, 0, 0]], 3, kept=2) == [0, 1]


def test_symmetric_equivalents_are_the_same() -> None:
    around = np.diag([-1.0, -1.0, 1.0, 1.0]) @ _moved(x=0.004)
    apart = Spacing(0.01, np.deg2rad(20), ONE, ONE).apart(_moved(x=0.004), around[None])
    assert apart[0] > 1
    of_object = np.array([np.eye(4), HALF_TURN])
    assert Spacing(0.01, 0.3, of_object, ONE).apart(_moved(x=0.004), around[None])[0] < 1e-6
    flipped = _moved(turn=np.pi)
    assert Spacing(0.01, 0.3, ONE, of_object).apart(_moved(), flipped[None])[0] < 1e-6


@pytest.mark.parametrize(("name", "turns"), [("parallel", 2), ("underactuated", 1)])
def test_jaws_are_the_same_after_half_a_turn(name: str, turns: int) -> None:
    gripper = load_gripper(name)
    hand = OpenHand.of(TrialRunner(brick(), gripper).scene, gripper)
    found = hand_symmetries(hand)
    assert len(found) == turns
    assert np.allclose(found[0], np.eye(4)) and np.allclose(
        found[-1], [np.eye(4), HALF_TURN][turns - 1]
    )


def test_symmetries_of_a_shape() -> None:
    found, told = shape_symmetries(brick())
    assert len(found) == 4 and "180°" in told
    lame = replace(brick(), vertices=brick().vertices * [1, 1, 1] + [0, 0, 0])
    lame.vertices[0] += 0.02
    assert len(shape_symmetries(lame)[0]) == 1
