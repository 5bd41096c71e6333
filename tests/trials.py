"""Trials by either built-in gripper of objects of simple shape."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float
from numpy import ndarray

from graspcast.pose.transforms import transform
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.objects.types import Grasp, GraspObject, Primitive
from graspcast.simulation.trial.trial import Outcome, TrialRunner, TrialSettings
from solids import box, cylinder, errors, from_above, raised, sphere

HEIGHTS = {"parallel": 0.025, "underactuated": 0.005}

GRIPPERS = sorted(HEIGHTS)

HANDS = ["parallel", pytest.param("underactuated", marks=pytest.mark.slow)]
"""Parameters of tests that take long with either: one of them is among the fast tests."""


def setup(
    gripper: str, target: GraspObject, height: float | None = None, **settings: object
) -> tuple[TrialRunner, Grasp]:
    """A runner and a grasp from above."""
    lying = bool(target.sim_T_ref[0, 2])
    at = HEIGHTS[gripper] if height is None else height
    runner = TrialRunner(target, load_gripper(gripper), replace(TrialSettings(), **settings))
    return runner, Grasp(from_above(target, at, along_y=lying), target.name, gripper)


def moved(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Float[ndarray, "4 4"]:
    return transform(np.eye(3), np.array([x, y, z]))


def timeless(outcome: Outcome) -> str:
    """Everything but the computing time, to the last bit."""
    return repr(replace(outcome, computed_s=0.0))


def nail() -> GraspObject:
    """A slippery shaft, 12 cm long, whose head catches on the fingers."""
    shaft = Primitive("box", (0.012, 0.012, 0.06), np.eye(4))
    head = Primitive("box", (0.035, 0.035, 0.005), raised(0.065))
    return replace(box(friction=0.01), name="nail", pieces=(shaft, head), sim_T_ref=raised(0.06))


def sample(gripper: str, count: int) -> Iterator[tuple[TrialRunner, Float[ndarray, "4 4"], Grasp]]:
    """Trials of easy and hard objects with small and large errors."""
    rng = np.random.default_rng(11)
    slippery = {"parallel": 0.15, "underactuated": 0.3}[gripper]
    targets = [
        (cylinder(), None),
        (cylinder(lying=True), 0.0),
        (box(0.05, 0.11, 0.15, mass_kg=0.6, mesh=True), 0.05),
        (box(friction=slippery), None),
        (cylinder(friction=slippery, mass_kg=0.8), None),
        (sphere(0.06), 0.0),
    ]
    for target, height in targets:
        runner, grasp = setup(gripper, target, height)
        for error in errors(rng, math.ceil(count / len(targets)), 0.018, 0.18):
            yield runner, error, grasp
