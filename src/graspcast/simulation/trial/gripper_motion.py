"""Motion of a hand that closes on nothing: which parts approach one another, and how.

It is seen in the simulated model; nothing is taken from the tool centre point that a gripper
states.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.simulation.engine import mujoco
from graspcast.simulation.trial.scene import HAND, Scene

__all__ = ["ClosingMotion", "closing_motion"]

_MOVES_M = 1e-3
_SHARE = 0.4
_CLEARLY = 2.0


@dataclass(frozen=True, eq=False)
class ClosingMotion:
    """How the parts of a closing hand approach one another, in the hand's base frame.

    Attributes
    ----------
    axis
        Direction in which the two sides close, of either sign; of a hand that closes from all
        sides, the axis to which they close.
    all_sides
        Whether the fingers close from all sides, as the jaws of a chuck do.
    first, second
        Geoms on the two sides that meet; of a hand that closes from all sides, ``second`` is empty.
    still
        Middle of the parts that do not move, metres.
    nearer_m
        By how much the parts come nearer that do so the most, metres.
    """

    axis: Float[ndarray, " 3"]
    all_sides: bool
    first: tuple[int, ...]
    second: tuple[int, ...]
    still: Float[ndarray, " 3"]
    nearer_m: float


def closing_motion(scene: Scene, postures: list[ndarray]) -> ClosingMotion | None:
    """Find out which parts of a hand approach one another, and along which direction.

    Parameters
    ----------
    scene
        A scene with the hand.
    postures
        ``data.qpos`` from open to closed.

    Returns
    -------
        None if no parts approach one another.
    """
    model = scene.model
    geoms = np.flatnonzero(scene.kind == HAND)
    middles = np.stack([_middles(scene, qpos, geoms) for qpos in postures])
    moving = np.linalg.norm(middles - middles[0], axis=2).max(axis=0) > _MOVES_M
    base = [scene.base_body]
    for body in range(scene.base_body + 1, model.nbody):
        if model.body_parentid[body] in base and not model.body_jntnum[body]:
            base.append(body)
    at_base = np.isin(model.geom_bodyid[geoms], base)
    still = middles[0][at_base].mean(axis=0) if at_base.any() else np.zeros(3)
    apart = _not_in_one_chain(model, model.geom_bodyid[geoms])
    # Fingers against each other; else, as of a single jaw, against what does not move.
    both = np.logical_and.outer(moving, moving) & apart
    for partners in (both, np.logical_xor.outer(moving, moving)):
        found = _pairs(middles, partners, single=partners is not both)
        if found is not None:
            break
    else:
        return None
    nearer, direction = found
    spread = np.einsum("ij,ijk,ijl->kl", nearer**2, direction, direction)
    values, vectors = np.linalg.eigh(spread)
    all_sides = bool(values[2] < _CLEARLY * values[1])
    axis = vectors[:, 0] if all_sides else vectors[:, 2]
    if all_sides:
        # An axis in no direction of approach has a sign, from the still parts to the moving.
        out = middles[-1][moving].mean(axis=0) - still
        axis = axis if axis @ out >= 0 else -axis
    most = float(nearer.max())
    chosen = nearer.max(axis=1) >= _SHARE * most
    toward = np.einsum("ij,ijk,k->i", nearer, direction, axis)
    if all_sides:
        return ClosingMotion(axis, True, tuple(geoms[chosen].tolist()), (), still, most)
    first, second = geoms[chosen & (toward > 0)], geoms[chosen & (toward < 0)]
    return ClosingMotion(axis, False, tuple(first.tolist()), tuple(second.tolist()), still, most)


def _middles(scene: Scene, qpos: ndarray, geoms: ndarray) -> Float[ndarray, "g 3"]:
    """Return the middles of geoms in a posture, in the base frame."""
    model, data = scene.model, scene.data
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    rotation = data.geom_xmat[geoms].reshape(-1, 3, 3)
    local = model.geom_aabb[geoms, :3]
    world = data.geom_xpos[geoms] + np.einsum("gij,gj->gi", rotation, local)
    base = data.xmat[scene.base_body].reshape(3, 3)
    middles: ndarray = (world - data.xpos[scene.base_body]) @ base
    return middles


def _not_in_one_chain(model: Any, bodies: ndarray) -> Bool[ndarray, "g g"]:
    """Return which pairs of bodies are not one another's ancestors."""
    above: list[set[int]] = []
    for body in bodies.tolist():
        chain, at = set(), body
        while at:
            chain.add(at)
            at = int(model.body_parentid[at])
        above.append(chain)
    apart = np.ones((len(bodies), len(bodies)), dtype=bool)
    for i, one in enumerate(bodies.tolist()):
        for j, other in enumerate(bodies.tolist()):
            apart[i, j] = one not in above[j] and other not in above[i]
    return apart


def _pairs(
    middles: Float[ndarray, "k g 3"], partners: Bool[ndarray, "g g"], *, single: bool
) -> tuple[Float[ndarray, "g g"], Float[ndarray, "g g 3"]] | None:
    """Return by how much pairs come nearer (metres), and the direction from one to the other."""
    between = middles[:, None, :, :] - middles[:, :, None, :]
    distance = np.linalg.norm(between, axis=3)
    nearest = distance.argmin(axis=0)
    least = np.take_along_axis(distance, nearest[None], axis=0)[0]
    nearer = np.where(partners, distance[0] - least, 0.0)
    if nearer.max(initial=0.0) < _MOVES_M:
        return None
    # Half-way on its way, a pair is neither far apart nor past one another.
    half = np.abs(distance - 0.5 * (distance[0] + least)).argmin(axis=0)
    direction = np.take_along_axis(between, half[None, ..., None], axis=0)[0]
    if single:  # the middle of what it closes on may be anywhere, as that of a palm is
        then = np.take_along_axis(between, nearest[None, ..., None], axis=0)[0]
        direction = direction - then
    length = np.maximum(np.linalg.norm(direction, axis=2, keepdims=True), 1e-9)
    return nearer, direction / length
