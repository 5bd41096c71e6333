"""Gap between the fingers of a closing hand, measured by rays against the simulated model."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.simulation.engine import mujoco
from graspcast.simulation.objects.types import box_corners
from graspcast.simulation.trial.gripper_motion import ClosingMotion
from graspcast.simulation.trial.scene import Scene

__all__ = ["Gap", "gap_of"]

_PITCH_M, _WITHIN_M = 0.002, 0.001
_MOST_LINES = 80
"""Most rows, and most columns, of rays; the pitch of a larger hand is coarser."""
_MOST = 0.8
_LONG, _NEARLY = 3.0, 0.7
_WIDTHS = (0.15, 0.3, 0.5, 0.7, 0.85)


@dataclass(frozen=True, eq=False)
class Gap:
    """Where the fingers meet on an object, in the hand's base frame, metres.

    Attributes
    ----------
    centre
        Middle of the gap, for an object half as wide as the opening.
    approach
        Direction of approach, out of the hand.
    opening_m
        Distance between the open fingers, where they touch such an object.
    low_m, high_m
        Range along the approach, from the base, in which the fingers touch objects of all widths.
    tip_m
        Farthest extent of the fingers along the approach.
    """

    centre: Float[ndarray, " 3"]
    approach: Float[ndarray, " 3"]
    opening_m: float
    low_m: float
    high_m: float
    tip_m: float


def gap_of(scene: Scene, postures: list[ndarray], motion: ClosingMotion) -> Gap | None:
    """Measure the gap between the fingers by rays in the postures of a closing hand.

    Parameters
    ----------
    scene, postures
        As for :func:`closing_motion`.
    motion
        What that returned.

    Returns
    -------
        None if the rays find no gap that closes.
    """
    rays: _Across | _Around = (_Around if motion.all_sides else _Across)(scene, motion)
    widths = rays.profile(postures)
    shown = np.where(np.isfinite(widths), widths, np.inf)
    # The fingers grasp where they close the most, not by parts near the palm.
    closes = widths[0] - np.maximum(shown.min(axis=0), 0.0)
    if not np.isfinite(closes).any():
        return None
    usable = closes >= _MOST * np.nanmax(closes)
    opening = float(widths[0][usable].max())
    # An object reaches into the hand by about half of the opening.
    tip = rays.farthest(postures)
    if (distal := usable & (rays.heights >= tip - 0.5 * opening)).any():
        usable = distal
    half = _touched(shown, usable, 0.5 * opening)
    if half is None:
        return None
    # At first the opening was that of any part, now it is that of the parts that touch.
    opening = float(np.median(widths[0][half[1]]))
    half = _touched(shown, usable, 0.5 * opening) or half
    along = [rays.heights[half[1]]]
    for share in _WIDTHS:
        touched = _touched(shown, usable, share * opening)
        if touched is not None:
            along.append(rays.heights[touched[1]])
    return Gap(
        centre=rays.middle(half[0], half[1]),
        approach=rays.approach,
        opening_m=opening,
        low_m=float(np.concatenate(along).min()),
        high_m=float(np.concatenate(along).max()),
        tip_m=tip,
    )


def _touched(widths: ndarray, usable: ndarray, width_m: float) -> tuple[int, ndarray] | None:
    """Return when the closing fingers first touch an object of a width, and in which rows."""
    there = usable & (widths[0] >= width_m)
    if not there.any():
        return None
    for k in range(1, len(widths)):
        least = widths[k][there].min()
        if least <= width_m:
            return k, there & (widths[k] <= least + _WITHIN_M)
    return None


class _Rays:
    """Rays in the base frame against chosen geoms of a hand."""

    def __init__(self, scene: Scene, motion: ClosingMotion):
        self.scene, self.motion = scene, motion
        self.model = copy.copy(scene.model)
        self.model.geom_group[:] = 0
        self.model.geom_group[list(motion.first)] = 1
        self.model.geom_group[list(motion.second)] = 2
        self.data = mujoco.MjData(self.model)
        self.geoms = np.array([*motion.first, *motion.second])
        self.hit = np.zeros(1, dtype=np.int32)
        self.heights = self.approach = np.zeros(0)

    def pose(self, qpos: ndarray) -> None:
        self.data.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, self.data)
        base = self.scene.base_body
        self.rotation = self.data.xmat[base].reshape(3, 3).copy()
        self.origin = self.data.xpos[base].copy()

    def corners(self, geoms: ndarray) -> Float[ndarray, "p 3"]:
        """Return corners of the boxes about geoms in the current posture."""
        rotation = self.data.geom_xmat[geoms].reshape(-1, 3, 3)
        local = self.model.geom_aabb[geoms]
        corners = local[:, None, :3] + box_corners(local[:, 3:])
        world = self.data.geom_xpos[geoms][:, None] + np.einsum("gij,gkj->gki", rotation, corners)
        points: ndarray = (world.reshape(-1, 3) - self.origin) @ self.rotation
        return points

    def cast(
        self, starts: Float[ndarray, "n 3"], directions: Float[ndarray, "n 3"], group: int
    ) -> Float[ndarray, " n"]:
        """Return the distances to the geoms of a group; NaN without a hit."""
        mask = np.zeros(6, dtype=np.uint8)
        mask[group] = 1
        points = starts @ self.rotation.T + self.origin
        vectors = directions @ self.rotation.T
        distances = np.array(
            [
                mujoco.mj_ray(self.model, self.data, point, vector, mask, 1, -1, self.hit)
                for point, vector in zip(points, vectors, strict=True)
            ]
        )
        return np.where(distances < 0, np.nan, distances)

    def extent(self, postures: list[ndarray], direction: ndarray) -> tuple[float, float]:
        """Return the least and greatest extent of the chosen geoms along a direction."""
        extents = []
        for qpos in postures:
            self.pose(qpos)
            extents.append(self.corners(self.geoms) @ direction)
        return float(np.min(extents)), float(np.max(extents))

    def farthest(self, postures: list[ndarray]) -> float:
        """Return the farthest extent of the chosen geoms along the approach."""
        return self.extent(postures, self.approach)[1]


class _Across(_Rays):
    """Rays along the closing direction, from outside onto the inner surfaces of the two sides.

    A row holds all rays of one height along the approach: an object may be as wide as the hand.
    """

    def profile(self, postures: list[ndarray]) -> Float[ndarray, "k r"]:
        """Return the width of the gap in each posture and row; NaN where a side has no surface."""
        axis = self.motion.axis
        self.pose(postures[len(postures) // 2])
        self.approach = self._approach(axis)
        self.aside = np.cross(self.approach, axis)
        few = [postures[0], postures[len(postures) // 2], postures[-1]]
        self.heights = _line(*self.extent(few, self.approach))
        self.columns = _line(*self.extent(few, self.aside))
        far = max(map(abs, self.extent(few, axis))) + 0.05
        onto = self.heights[:, None, None] * self.approach + self.columns[:, None] * self.aside
        onto = onto.reshape(-1, 3)
        ahead, back = np.tile(axis, (len(onto), 1)), np.tile(-axis, (len(onto), 1))
        lows, highs = [], []
        shape = (len(self.heights), len(self.columns))
        for qpos in postures:
            self.pose(qpos)
            # ``first`` is on the low side: its inner surface is seen from the high side.
            lows.append((far - self.cast(onto + far * axis, back, 1)).reshape(shape))
            highs.append((self.cast(onto - far * axis, ahead, 2) - far).reshape(shape))
        self.low = np.nan_to_num(np.array(lows), nan=-np.inf)
        self.high = np.nan_to_num(np.array(highs), nan=np.inf)
        width = self.high.min(axis=2) - self.low.max(axis=2)
        return np.where(np.isfinite(width), width, np.nan)

    def _approach(self, axis: Float[ndarray, " 3"]) -> Float[ndarray, " 3"]:
        """Return the direction out of the hand: that of long fingers, else from its still parts."""
        sides = [self.corners(np.array(s)) for s in (self.motion.first, self.motion.second)]
        out = np.mean([side.mean(axis=0) for side in sides], axis=0) - self.motion.still
        out = out - (out @ axis) * axis
        distance = float(np.linalg.norm(out))
        if distance < 1e-6:
            return _plane(axis)[0]
        out = out / distance
        across = np.concatenate([side - side.mean(axis=0) for side in sides])
        across = across - np.outer(across @ axis, axis)
        spread, directions = np.linalg.eigh(across.T @ across)
        along = directions[:, 2] if directions[:, 2] @ out > 0 else -directions[:, 2]
        return along if spread[2] > _LONG * spread[1] and along @ out > _NEARLY else out

    def middle(self, k: int, rows: Bool[ndarray, " r"]) -> Float[ndarray, " 3"]:
        """Return the middle between the innermost surfaces of the two sides."""
        low, high = self.low[k][rows], self.high[k][rows]
        heights, columns = self.heights[rows], self.columns
        middles = []
        for touching, value in (
            (low >= low.max() - _WITHIN_M, low.max()),
            (high <= high.min() + _WITHIN_M, high.min()),
        ):
            row, column = np.nonzero(touching)
            middles.append([value, columns[column].mean(), heights[row].mean()])
        axes = np.stack([self.motion.axis, self.aside, self.approach])
        middle: ndarray = np.mean(middles, axis=0) @ axes
        return middle


class _Around(_Rays):
    """Rays from the axis to which a hand closes outwards onto its fingers."""

    def profile(self, postures: list[ndarray]) -> Float[ndarray, "k r"]:
        """Return twice the distance of the fingers from the axis in each posture and row."""
        self.approach = axis = self.motion.axis
        u, v = _plane(axis)
        self.pose(postures[len(postures) // 2])
        parts = [self.corners(np.array([g])).mean(axis=0) for g in self.motion.first]
        self.foot = np.mean(parts, axis=0)
        self.foot -= (self.foot @ axis) * axis
        self.heights = _line(*self.extent([postures[0], postures[-1]], axis))
        angles = np.radians(np.arange(0, 360, 10))
        rays = np.cos(angles)[:, None] * u + np.sin(angles)[:, None] * v
        starts = self.foot + np.repeat(self.heights, len(angles))[:, None] * axis
        directions = np.tile(rays, (len(self.heights), 1))
        widths = []
        for qpos in postures:
            self.pose(qpos)
            found = self.cast(starts, directions, 1).reshape(len(self.heights), -1)
            widths.append(2 * np.nan_to_num(found, nan=np.inf).min(axis=1))
        width = np.array(widths)
        return np.where(np.isfinite(width), width, np.nan)

    def middle(self, k: int, rows: Bool[ndarray, " r"]) -> Float[ndarray, " 3"]:
        """Return the place on the axis between the rows."""
        return self.foot + float(self.heights[rows].mean()) * self.approach


def _plane(axis: ndarray) -> tuple[ndarray, ndarray]:
    """Return two directions across an axis and each other."""
    u = np.eye(3)[np.abs(axis).argmin()]
    u = u - (u @ axis) * axis
    u = u / np.linalg.norm(u)
    return u, np.cross(axis, u)


def _line(low: float, high: float) -> Float[ndarray, " n"]:
    """Return the middles of equal parts of a range."""
    count = min(_MOST_LINES, max(1, round((high - low) / _PITCH_M)))
    return low + (np.arange(count) + 0.5) * (high - low) / count
