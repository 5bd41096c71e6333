from __future__ import annotations

import numpy as np
import pytest

from bricks import brick, from_top
from graspcast.pose.transforms import invert, transform_points
from graspcast.simulation.grasps.proposals import OpenHand, propose, surface_points, vary
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.trial.trial import TrialRunner

HANDS = ("parallel", "underactuated")


def _hand(name: str) -> OpenHand:
    gripper = load_gripper(name)
    return OpenHand.of(TrialRunner(brick(), gripper).scene, gripper)


@pytest.mark.parametrize("name", HANDS)
def test_the_palm_is_where_it_is(name: str) -> None:
    palm = {"parallel": 0.1034 - 0.066, "underactuated": 0.075}[name]
    assert _hand(name).reach_m == pytest.approx(palm, abs=1e-3)


def test_proposals_span_the_object_and_come_from_above_the_table() -> None:
    thing, hand = brick(), _hand("parallel")
    points = surface_points(thing, 3000, np.random.default_rng(0))
    assert np.all(np.isclose(np.abs(points), [0.025, 0.045, 0.035]).any(axis=1))
    found = propose(thing, hand, 80, np.random.default_rng(1), points)
    again = propose(thing, hand, 80, np.random.default_rng(1), points)
    assert len(found) == 80 and np.array_equal(found, again)
    world = thing.sim_T_ref @ found
    assert np.all(world[:, 2, 2] < 1e-9), "none comes from below"
    # The fingers close where the object is, and it is no wider there than they open.
    for pose in found:
        local = points @ pose[:3, :3] + invert(pose)[:3, 3]
        between = local[(np.abs(local[:, 1]) < 0.012) & (local[:, 2] < 0.01)]
        assert np.abs(between[:, 0]).min() < hand.opening_m / 2
        assert np.ptp(between[:, 0]) < hand.opening_m


def test_variations_are_near_and_rigid() -> None:
    rng = np.random.default_rng(0)
    steps = np.array(
        [invert(from_top(0.02)) @ vary(from_top(0.02), 0.004, 0.07, rng) for _ in range(400)]
    )
    assert np.allclose(steps[:, :3, 3].std(axis=0), 0.004, rtol=0.15)
    assert np.allclose(steps[:, :3, :3] @ np.swapaxes(steps[:, :3, :3], 1, 2), np.eye(3))


def test_geometry_alone_sees_what_is_in_the_way() -> None:
    hand, points = _hand("parallel"), surface_points(brick(), 2000, np.random.default_rng(0))
    shifts = np.tile(np.eye(4), (3, 1, 1))
    shifts[1, 0, 3], shifts[2, 2, 3] = 0.02, 0.2
    seen = transform_points(invert(shifts), points)
    # Well placed; a finger coming down on the box; nothing between the fingers.
    assert hand.predict(from_top(0.02), seen, 0.001).tolist() == [True, False, False]
