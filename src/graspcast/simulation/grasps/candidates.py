"""Candidates: grasps proposed from an object's shape of which the open hand reaches the place.

Half of them close on antipodal pairs of points, half enclose the object. The hand must span the
object where it closes, and its straight approach must be clear of object and table.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.simulation.grasps.antipodal import ContactPairs, contact_pairs
from graspcast.simulation.grasps.clearance import clear_approach
from graspcast.simulation.grasps.proposals import OpenHand, propose, surface_points
from graspcast.simulation.grasps.trial_pool import TrialPool

__all__ = ["MARGIN_M", "Candidates", "candidates_of"]

MARGIN_M = 0.001
"""Play between the object and each open finger, metres."""

_SLACK_M = 0.002
_RAYS, _PAIRS, _AROUND = 1500, 300, 3
_LEVEL = 0.2
_TIP_M = 0.004


@dataclass(frozen=True, eq=False)
class Candidates:
    """Grasps that the open hand reaches, and why others were left out.

    Attributes
    ----------
    obj_T_grasp
        The grasps, (n, 4, 4).
    origin
        ``"antipodal"`` or ``"enclosing"``, for each.
    narrowest_m
        Smallest distance of two points that the fingers could close on, metres; NaN if none.
    rejected
        Number of proposals left out, by reason: ``too wide``, ``too slippery``, ``object``,
        ``table``.
    """

    obj_T_grasp: Float[ndarray, "n 4 4"]
    origin: tuple[str, ...]
    narrowest_m: float
    rejected: Counter[str] = field(default_factory=Counter)

    def __len__(self) -> int:
        return len(self.origin)


def candidates_of(pool: TrialPool, hand: OpenHand, rng: np.random.Generator) -> Candidates:
    """Propose grasps from the shape of the pool's object, and leave out those out of reach.

    Parameters
    ----------
    pool
        The pool of trials of the object by the gripper.
    hand
        The open hand.
    rng
        Random generator.
    """
    thing = pool.grasp_object
    pairs = contact_pairs(thing, _RAYS, rng)
    facing = pairs.slope <= thing.friction
    fits = pairs.width_m <= hand.opening_m - 2 * MARGIN_M
    rejected = Counter(
        {"too wide": int((~fits).sum()), "too slippery": int((fits & ~facing).sum())}
    )
    narrowest = float(pairs.width_m[facing].min()) if facing.any() else float("nan")
    good = rng.permutation(np.flatnonzero(fits & facing))[:_PAIRS]
    raw = [(pose, "antipodal") for pose in _across(pairs.chosen(good), thing.sim_T_ref, rng)]
    enclosing = propose(thing, hand, _PAIRS, rng, surface_points(thing, 4000, rng))
    raw += [(pose, "enclosing") for pose in enclosing]
    reached = pool.map(
        lambda runner, pose: clear_approach(
            runner.scene, pool.gripper, thing.sim_T_ref @ pose, 0.8 * hand.reach_m
        ),
        [pose for pose, _ in raw],
    )
    shallowest = _TIP_M - hand.tip_m
    kept, origins = [], []
    for (pose, origin), clear in zip(raw, reached, strict=True):
        deepest = clear.reaches_m - _SLACK_M
        if deepest < shallowest:
            rejected[str(clear.hit)] += 1
            continue
        for depth in (float(rng.uniform(shallowest, deepest)), deepest):
            kept.append(_deeper(pose, depth))
            origins.append(origin)
    return Candidates(np.array(kept).reshape(-1, 4, 4), tuple(origins), narrowest, rejected)


def _deeper(pose: Float[ndarray, "4 4"], depth_m: float) -> Float[ndarray, "4 4"]:
    moved = pose.copy()
    moved[:3, 3] += depth_m * pose[:3, 2]
    return moved


def _across(
    pairs: ContactPairs, sim_T_obj: Float[ndarray, "4 4"], rng: np.random.Generator
) -> list[Float[ndarray, "4 4"]]:
    """Return grasps that close on pairs of points, approaching from random sides but not below."""
    found = []
    for first, second in zip(pairs.first, pairs.second, strict=True):
        x = (second - first) / np.linalg.norm(second - first)
        up = sim_T_obj[2, :3]
        aside = np.cross(x, np.eye(3)[np.abs(x).argmin()])
        aside /= np.linalg.norm(aside)
        other = np.cross(x, aside)
        made = 0
        for angle in rng.uniform(0, 2 * np.pi, 6 * _AROUND):
            z = np.cos(angle) * aside + np.sin(angle) * other
            if z @ up > _LEVEL:
                continue
            pose = np.eye(4)
            pose[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
            pose[:3, 3] = (first + second) / 2
            found.append(pose)
            made += 1
            if made == _AROUND:
                break
    return found
