"""Symmetries of a mesh: the rotations that leave its shape as it is, found and measured.

Only the shape is looked at, no colour or texture, and only rotations, since a mirrored object is
another one. A symmetry leaves the middle of the surface in place and commutes with its second
moments, which leaves few axes to try. Each is refined, and kept if the rotated surface lies on the
surface. Discrete symmetries are kept as a group: with two rotations, one after the other as well.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import ContinuousSymmetry
from graspcast.pose.transforms import (
    rotation_angle,
    rotation_from_vector,
    rotation_vector,
    transform,
)
from graspcast.simulation.objects.rotation_groups import closed_group
from graspcast.simulation.objects.surface import Surface

__all__ = ["Deviation", "Symmetries", "find_symmetries"]

WITHIN = 0.03
"""How far 99 % of the rotated surface may be from the surface, by the diameter across the axis."""

_ANYWHERE, _FLOOR, _STANDS_OUT = 0.05, 0.01, 12.0
_SLENDER = 3.0
_ALIKE = 0.12
_MOST_FOLD = 36
_ANY_ANGLE = np.deg2rad([49.0, 23.0, 71.0, 111.0, 157.0, 180.0])
_SNAP_RAD = np.deg2rad(2.0)
_SAME_RAD = np.deg2rad(0.1)
_APART_RAD = np.deg2rad(10.0)
_ROUGH = 100
_KEPT = 6
_ROUGHLY = 0.03


@dataclass(frozen=True)
class Deviation:
    """How far a rotated surface is from the surface.

    Attributes
    ----------
    usual_m
        Distance that 90 % of the surface keeps to, metres.
    nearly_m
        Distance that 99 % of it keeps to.
    largest_m
        Largest distance.
    across_m
        Diameter of the surface across the axis of rotation; of a slender object at most three
        times its width, so that a knife is not the same from both ends.
    """

    usual_m: float
    nearly_m: float
    largest_m: float
    across_m: float

    @property
    def small(self) -> bool:
        """Whether the rotation is a symmetry.

        What differs in one place alone, a hole in a plate, stands out against what differs
        everywhere, the noise of a scan.
        """
        noise = _FLOOR * self.across_m + _STANDS_OUT * self.usual_m
        return self.nearly_m <= WITHIN * self.across_m and self.largest_m <= min(
            _ANYWHERE * self.across_m, noise
        )


@dataclass(frozen=True, eq=False)
class Symmetries:
    """Rotations that leave a shape as it is, as ``models_info.json`` holds them.

    Attributes
    ----------
    continuous
        Axes about which any angle is a symmetry; three for a ball.
    discrete
        The other symmetries without the identity, (s, 4, 4).
    deviation_m
        Distance of 99 % of the rotated surface from the surface, the largest of all symmetries.
    """

    continuous: tuple[ContinuousSymmetry, ...]
    discrete: Float[ndarray, "s 4 4"]
    deviation_m: float = 0.0

    def __str__(self) -> str:
        """Return them in words: ``"any angle about z, 180° about x"``; ``"none"``."""
        if len(self.continuous) > 2:
            return "any rotation (a ball)"
        words = [f"any angle about {axis_name(s.axis)}" for s in self.continuous]
        folds: dict[str, int] = {}
        axes: dict[str, ndarray] = {}
        for pose in self.discrete:
            axis, angle = _axis_angle(pose[:3, :3])
            alike = (n for n, known in axes.items() if abs(known @ axis) >= np.cos(_SNAP_RAD))
            name = next(alike, axis_name(axis))
            axes.setdefault(name, axis)
            folds[name] = max(folds.get(name, 2), round(2 * np.pi / angle))
        ordered = sorted(folds.items(), key=lambda item: (-item[1], len(item[0]), item[0]))
        if len(ordered) > 3:
            words.append(f"{len(self.discrete)} rotations")
            ordered = ordered[:3]
        words += [f"{360 / fold:.4g}° about {name}" for name, fold in ordered]
        return ", ".join(words) or "none"


def axis_name(axis: Float[ndarray, " 3"]) -> str:
    """Return ``"z"`` for an axis along a coordinate axis (to 2°), else its direction."""
    k = int(np.argmax(np.abs(axis)))
    if np.abs(axis[k]) >= np.cos(_SNAP_RAD):
        return "xyz"[k]
    x, y, z = np.round(axis * np.sign(axis[k]), 2) + 0.0
    return f"({x:g}, {y:g}, {z:g})"


def find_symmetries(surface: Surface) -> Symmetries:
    """Find the symmetries of a shape.

    An axis within 2° of a coordinate axis, and a centre near the origin, are set to these if the
    shape fits as well.
    """
    rough = _Rough(surface)
    round_axes = _round_axes(surface, rough)
    if len(round_axes) > 1:
        return symmetries_about(surface, np.eye(3))
    if round_axes:
        return symmetries_about(surface, np.array(round_axes), flips=_flips(round_axes[0]))
    group = [np.eye(3)]
    for rotation in rough.discrete():
        if any(rotation_angle(rotation.T @ known) < _spacing(group) for known in group):
            continue
        larger = closed_group([*group, rotation], _spacing([*group, rotation]))
        if larger is not None and all(_holds(surface, R) for R in larger if not _known(R, group)):
            group = list(larger)
    return symmetries_about(surface, np.empty((0, 3)), np.array(group[1:]).reshape(-1, 3, 3))


def _known(rotation: ndarray, group: Sequence[ndarray]) -> bool:
    return any(rotation_angle(rotation.T @ element) < _SAME_RAD for element in group)


def symmetries_about(
    surface: Surface,
    axes: Float[ndarray, "a 3"],
    rotations: Float[ndarray, "r 3 3"] | None = None,
    *,
    flips: Iterable[Float[ndarray, "3 3"]] = (),
) -> Symmetries:
    """Put rotations about a shape's centre into the form of ``models_info.json``.

    Parameters
    ----------
    surface
        The shape.
    axes
        Axes of continuous symmetries.
    rotations
        Discrete symmetries.
    flips
        Further ones, of which the first that the shape has is taken.
    """
    discrete = [] if rotations is None else list(rotations)
    discrete += [flip for flip in flips if deviation(surface, flip).small][:1]
    turned = [rotation_from_vector(axis * angle) for axis in axes for angle in _ANY_ANGLE]
    middle = _middle(surface, [*turned, *discrete])
    poses = [transform(R, middle - R @ middle) for R in discrete]
    return Symmetries(
        tuple(ContinuousSymmetry(axis, middle - axis * (axis @ middle)) for axis in axes),
        np.array(poses).reshape(-1, 4, 4),
        max((deviation(surface, R, middle).nearly_m for R in [*turned, *discrete]), default=0.0),
    )


def deviation(
    surface: Surface,
    rotation: Float[ndarray, "3 3"],
    middle: Float[ndarray, " 3"] | None = None,
) -> Deviation:
    """Measure how far a surface is from itself after a rotation about a point."""
    middle = surface.centroid if middle is None else middle
    axis, _ = _axis_angle(rotation)
    by_area, details = (
        surface.distances((points - middle) @ rotation.T + middle)
        for points in (surface.by_area, surface.details)
    )
    radius = np.linalg.norm(np.cross(surface.corners - middle, axis), axis=1).max()
    across = min(2 * radius, _SLENDER * surface.width_m)
    usual, nearly = np.quantile(by_area, [0.9, 0.99])
    largest = max(by_area.max(), details.max())
    return Deviation(float(usual), float(nearly), float(largest), float(across))


def _holds(surface: Surface, rotation: Float[ndarray, "3 3"]) -> bool:
    """Return whether a rotation about the centroid is a symmetry, after a look at few points."""
    few = surface.by_area[::10] - surface.centroid
    apart = surface.distances(few @ rotation.T + surface.centroid)
    if np.quantile(apart, 0.8) > WITHIN * surface.diameter_m:
        return False
    return deviation(surface, rotation).small


def _middle(surface: Surface, rotations: Sequence[ndarray]) -> Float[ndarray, " 3"]:
    """Return the origin if the rotations are as good about it, else the surface's centroid."""
    origin = np.zeros(3)
    near = np.linalg.norm(surface.centroid) <= 0.02 * surface.diameter_m
    return origin if near and _as_good(surface, rotations, origin) else surface.centroid


def _as_good(surface: Surface, rotations: Sequence[ndarray], middle: ndarray) -> bool:
    for rotation in rotations:
        there, here = deviation(surface, rotation, middle), deviation(surface, rotation)
        slack = 0.1 * _FLOOR * here.across_m
        if not there.small or there.nearly_m > 1.25 * here.nearly_m + slack:
            return False
    return True


def _round_axes(surface: Surface, rough: _Rough) -> list[ndarray]:
    """Return an axis about which any angle is a symmetry; three if it is a ball; else none."""
    found: list[ndarray] = []
    for axis in rough.round():
        turned = (rotation_from_vector(axis * angle) for angle in _ANY_ANGLE)
        if all(_holds(surface, R) for R in turned):
            found.append(axis)
            if abs(found[0] @ axis) < np.cos(2 * _APART_RAD):
                break
    best = found[:1]
    return [*best, found[-1]] if found and abs(found[0] @ found[-1]) < 0.9 else best


def _flips(axis: ndarray) -> list[ndarray]:
    """Return half turns about axes across a given one, those along coordinate axes first."""
    across = [np.cross(axis, e) for e in np.eye(3)[[1, 0, 2]]]
    lengths = [float(np.linalg.norm(a)) for a in across]
    return [_turn(a / n, 2.0) for a, n in zip(across, lengths, strict=True) if n > 0.5]


def _turn(axis: ndarray, fold: float | int) -> ndarray:
    return rotation_from_vector(axis * (2 * np.pi / fold))


def _axis_angle(rotation: ndarray) -> tuple[ndarray, float]:
    """Return the axis and the angle, in [0, pi], of a rotation."""
    vector = rotation_vector(rotation)
    angle = float(np.linalg.norm(vector))
    return (vector / angle, angle) if angle > 1e-9 else (np.array([0.0, 0.0, 1.0]), 0.0)


def _spacing(group: Sequence[ndarray]) -> float:
    """Return the angle below which two rotations are the same one, radians."""
    angles = [float(rotation_angle(R)) for R in group]
    return 0.4 * min([*(a for a in angles if a > 1e-6), np.deg2rad(30.0)])


class _Rough:
    """Axes and rotations that may be symmetries, by a quick look at few points."""

    def __init__(self, surface: Surface):
        self.surface = surface
        self.points = surface.samples[:: len(surface.samples) // _ROUGH] - surface.centroid
        moments, axes = np.linalg.eigh(surface.moments)
        self.axes = axes.T
        gap = np.diff(moments) / moments[-1]
        self.alike = gap < _ALIKE

    def round(self) -> list[ndarray]:
        """Return axes about which any angle may be a symmetry, refined, the best first."""
        if self.alike.all():
            return self._best(_half_sphere(), 360 / 49)
        if not self.alike.any():
            return []
        return [self._refined(self._single, 360 / 49)]

    def discrete(self) -> list[ndarray]:
        """Return rotations that may be symmetries, refined, those of most folds first."""
        if self.alike.all():
            return [
                _turn(axis, fold)
                for fold in (5, 4, 3, 2)
                for axis in self._best(_half_sphere(), fold)
            ]
        if not self.alike.any():
            return [_turn(self._refined(axis, 2), 2) for axis in self.axes]
        folds = [
            _turn(self._refined(self._single, fold), fold)
            for fold in range(_MOST_FOLD, 1, -1)
            if self._apart(self._single[None], fold)[0] < 4 * self._apart(self._single[None], 1)[0]
        ]
        first, second = np.delete(self.axes, self._single_number, axis=0)
        angle = np.deg2rad(np.arange(0, 180, 2.0))[:, None]
        plane = np.cos(angle) * first + np.sin(angle) * second
        return folds + [_turn(axis, 2) for axis in self._best(plane, 2)]

    @property
    def _single_number(self) -> int:
        """Number of the principal axis whose moment is unlike the others."""
        return 2 if self.alike[0] else 0

    @property
    def _single(self) -> ndarray:
        axis: ndarray = self.axes[self._single_number]
        return axis

    def _apart(self, axes: ndarray, fold: float | int) -> ndarray:
        """Return the mean distance from the surface after a turn about each axis, metres."""
        turned = _turn(axes, fold) @ self.points.T
        moved = np.swapaxes(turned, -1, -2) + self.surface.centroid
        mean: ndarray = self.surface.roughly(moved).mean(axis=-1)
        return mean

    def _best(self, axes: ndarray, fold: float | int) -> list[ndarray]:
        """Return the axes about which a turn moves the surface least, apart, and refined."""
        apart = self._apart(axes, fold)
        most = self._apart(axes[:1], 1)[0] + _ROUGHLY * self.surface.diameter_m
        kept: list[ndarray] = []
        for i in np.argsort(apart):
            if apart[i] <= most and all(
                abs(axes[i] @ other) < np.cos(_APART_RAD) for other in kept
            ):
                kept.append(axes[i])
            if len(kept) == _KEPT or apart[i] > most:
                break
        return [self._refined(axis, fold) for axis in kept]

    def _refined(self, axis: ndarray, fold: float | int) -> ndarray:
        """Tilt an axis until the turned points are nearest; take a coordinate axis if as good."""
        from scipy.optimize import least_squares

        straight = np.eye(3)[np.argmax(np.abs(axis))]
        near = abs(axis @ straight) >= np.cos(_SNAP_RAD)
        here = deviation(self.surface, _turn(straight, fold)) if near else None
        if here is not None and here.nearly_m <= 0.1 * WITHIN * here.across_m:
            return straight
        side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        side /= np.linalg.norm(side)
        other = np.cross(axis, side)

        def tilted(x: ndarray) -> ndarray:
            moved = axis + x[0] * side + x[1] * other
            unit: ndarray = moved / np.linalg.norm(moved)
            return unit

        def apart(x: ndarray) -> ndarray:
            moved = self.points @ _turn(tilted(x), fold).T + self.surface.centroid
            return self.surface.quickly(moved)

        found = least_squares(apart, [0.0, 0.0], diff_step=1e-3, x_scale=0.05, max_nfev=10)
        refined = tilted(found.x)
        if here is None:
            return refined
        best = deviation(self.surface, _turn(refined, fold))
        return straight if here.nearly_m <= 1.25 * best.nearly_m else refined


def _half_sphere(count: int = 500) -> Float[ndarray, "n 3"]:
    """Return directions spread evenly over half a sphere (Fibonacci), coordinate axes first."""
    z = (np.arange(count) + 0.5) / count
    angle = np.arange(count) * np.pi * (3 - np.sqrt(5))
    flat = np.sqrt(1 - z**2)
    spread = np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=-1)
    return np.concatenate([np.eye(3), spread])
