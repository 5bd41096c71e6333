from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.pose.transforms import exp, invert, transform_points
from graspcast.simulation.campaign.requests import TrialRequests
from graspcast.simulation.grasps.observed_trials import ObservedTrials
from graspcast.simulation.grasps.proposals import OpenHand, propose, surface_points, vary
from graspcast.simulation.grasps.sampling import FittedTrials
from graspcast.simulation.grasps.search import (
    SearchEffort,
    fit_grasp,
    jitter_held,
    report_grasp,
    simulated,
)
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.objects.types import Grasp, GraspObject
from graspcast.simulation.trial.trial import TrialRunner
from solids import box

SMALL = SearchEffort(proposals=60, racers=6, children=3, first=6, last=24, choose=24)
HANDS = ("parallel", "underactuated")


def brick() -> GraspObject:
    """A box with a mesh: 50 x 90 x 70 mm, so that only x fits between parallel fingers."""
    thing = box(0.05, 0.09, 0.07)
    half = np.array([0.05, 0.09, 0.07]) / 2
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return replace(thing, vertices=corners, faces=np.array(faces))


def from_top(depth_m: float) -> Float[ndarray, "4 4"]:
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0])
    pose[2, 3] = 0.035 - depth_m
    return pose


def errors(count: int, seed: int) -> Float[ndarray, "n 4 4"]:
    rng = np.random.default_rng(seed)
    return exp(rng.standard_normal((count, 6)) * np.repeat([0.015, 0.15], 3))


def truth(count: int, seed: int) -> FittedTrials:
    """What our own simulator says of a grasp that the search does not know."""
    runner = TrialRunner(brick(), load_gripper("parallel"))
    grasp = Grasp(from_top(0.025), "box", "parallel")
    poses = errors(count, seed)
    empty = FittedTrials(poses, np.zeros(count, dtype=bool))
    return FittedTrials(poses, simulated(runner, grasp, empty))


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


@pytest.mark.slow
def test_the_search_finds_a_grasp_that_behaves_like_the_unknown_one() -> None:
    report = truth(120, seed=3)
    found = fit_grasp(
        brick(), load_gripper("parallel"), truth(120, seed=1), truth(60, seed=2), effort=SMALL
    )
    scored = report_grasp(found, brick(), load_gripper("parallel"), report)
    assert 0.2 < scored.given_rate < 0.8
    assert scored.accuracy > scored.majority + 0.1 and scored.kappa > 0.5
    assert found.held == 20
    runner = TrialRunner(brick(), load_gripper("parallel"))
    again = jitter_held(runner, found.grasp)
    assert again == jitter_held(runner, found.grasp)
    figures = found.reference(0, scored).agreement
    assert figures["report_accuracy"] == round(scored.accuracy, 4)
    assert figures["candidates"] == found.candidates > 6


@pytest.mark.slow
def test_the_same_seed_finds_the_same_grasp_whatever_the_report_part_says() -> None:
    """The search is given two parts; poisoning the third cannot change what it finds."""
    labelled = truth(150, seed=1)
    part = np.repeat(["fit", "choose", "report"], 50)
    keys = pl.DataFrame({"im_id": np.arange(150)}).with_columns(
        estimator=pl.lit("e"),
        dataset=pl.lit("d"),
        scene_id=pl.lit(0),
        obj_id=pl.lit(0),
        est_id=pl.lit(0),
        gripper=pl.lit("parallel"),
        object=pl.lit("box"),
    )
    poisoned = labelled.success ^ (part == "report")
    poses = []
    for success in (labelled.success, poisoned):
        trials = ObservedTrials(TrialRequests(keys, labelled.obj_T_est), success, part)
        found = fit_grasp(
            brick(),
            load_gripper("parallel"),
            trials.of("box", "parallel", "fit"),
            trials.of("box", "parallel", "choose"),
            effort=replace(SMALL, racers=4, children=1, last=12, choose=12),
            seed=5,
        )
        poses.append((found.grasp.obj_T_grasp, found.fit, found.choose, found.trials))
    assert np.array_equal(poses[0][0], poses[1][0]) and poses[0][1:] == poses[1][1:]


def test_a_part_without_trials() -> None:
    none = FittedTrials(np.zeros((0, 4, 4)), np.zeros(0, dtype=bool))
    one = FittedTrials(np.eye(4)[None], np.ones(1, dtype=bool))
    with pytest.raises(InputError, match="no outcomes in the choose part"):
        fit_grasp(brick(), load_gripper("parallel"), one, none)
