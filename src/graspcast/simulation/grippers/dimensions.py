"""Dimensions of a hand: its size, held against the opening that it states."""

from __future__ import annotations

from typing import Any

import numpy as np

from graspcast.pose.lengths import Reference, between, shown, unit_problem

__all__ = ["hand_size_m", "size_problem"]

_HANDS = Reference("hands are 20 mm to 3 m across", 0.02, 3.0, (0.05, 0.6))

_FINITE = (
    *("body_pos", "body_mass", "body_inertia", "geom_pos", "geom_size", "geom_aabb", "jnt_range"),
    *("jnt_stiffness", "dof_damping", "dof_armature", "actuator_gainprm", "actuator_biasprm"),
)


def hand_size_m(model: Any) -> float:
    """Return the largest side of the bounding box of a compiled hand, metres."""
    from graspcast.simulation.engine import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    # Geoms of the world, such as a floor in the hand's file, are no part of the hand.
    chosen = np.flatnonzero(model.geom_bodyid != 0)
    if not len(chosen):
        return float("nan")
    rotation = data.geom_xmat[chosen].reshape(-1, 3, 3)
    local = model.geom_aabb[chosen]
    middle = data.geom_xpos[chosen] + np.einsum("gij,gj->gi", rotation, local[:, :3])
    half = np.einsum("gij,gj->gi", np.abs(rotation), local[:, 3:])
    return float(((middle + half).max(axis=0) - (middle - half).min(axis=0)).max())


def size_problem(model: Any, max_opening_m: float) -> str:
    """Say what is wrong with a hand's size, or with its opening for its size; empty if nothing.

    Parameters
    ----------
    model
        The compiled hand.
    max_opening_m
        Its stated opening.
    """
    for name in _FINITE:
        if not np.isfinite(getattr(model, name)).all():
            return f"the hand's model has values of {name} that are not finite numbers"
    size = hand_size_m(model)
    if problem := unit_problem("the hand's model", size, _HANDS, unit="m"):
        return f"{problem} (MJCF is in metres; <mesh scale=...> converts meshes)"
    low, high = 0.01 * size, 2.5 * size
    across = f"the hand is {shown(size)} across"
    usual = Reference(across, low, high, (0.1 * size, 1.5 * size))
    if problem := unit_problem("max_opening_m", max_opening_m, usual, unit="m"):
        return f"{problem} Of such a hand, {between(low, high)} would fit."
    return ""
