"""Clear approach: how far the open hand gets towards a grasp before it touches anything."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

from jaxtyping import Float
from numpy import ndarray

from graspcast.pose.transforms import compose, invert
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.trial.scene import HAND, OBJECT, Scene

__all__ = ["ClearApproach", "clear_approach"]

_STEP_M = 0.004


class ClearApproach(NamedTuple):
    """How far a straight approach is clear.

    Attributes
    ----------
    reaches_m
        How far beyond the grasp the open hand gets, along its approach; below zero if it does not
        get there; ``-inf`` if it touches something at the start.
    hit
        What stops it; None if it gets as far as was asked for.
    """

    reaches_m: float
    hit: Literal["object", "table"] | None


def clear_approach(
    scene: Scene, gripper: Gripper, sim_T_grasp: Float[ndarray, "4 4"], beyond_m: float
) -> ClearApproach:
    """Move the open hand along the approach of a trial, and find where it first touches anything.

    No time is simulated, and object and table stay where they are.

    Parameters
    ----------
    scene
        The scene; its state is changed.
    gripper
        The gripper of the scene.
    sim_T_grasp
        The grasp in the world.
    beyond_m
        How far beyond the grasp to look, metres.
    """
    target = sim_T_grasp.copy()
    target[:3, 3] += beyond_m * sim_T_grasp[:3, 2]
    start = -(scene.settings.standoff_m + beyond_m)
    scene.place(compose(target, invert(gripper.base_T_tcp)), start)
    if scene.hand_in_contact():
        return ClearApproach(-math.inf, _hit(scene))
    steps = math.ceil(-start / _STEP_M)
    for k in range(max(1, math.floor(scene.clearance_m() / _STEP_M)), steps + 1):
        scene.move_hand(min(0.0, start + k * _STEP_M))
        if scene.hand_in_contact():
            return ClearApproach(beyond_m + start + (k - 1) * _STEP_M, _hit(scene))
    return ClearApproach(beyond_m, None)


def _hit(scene: Scene) -> Literal["object", "table"]:
    """Return what the hand touches; the object if it touches both."""
    kinds = scene.kind[scene.data.contact.geom].sum(axis=1).tolist()
    return "object" if HAND + OBJECT in kinds else "table"
