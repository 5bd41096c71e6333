"""Next look: from where a further view of an object would tell most about its position.

The rule is plain geometry. Let e be the axis of largest uncertainty of the position. A camera that
looks perpendicular to e sees errors along it. Of the directions perpendicular to e, the one
nearest to the present viewing direction is taken, with a turn of at most 60 degrees, and of at
least the parallax that a view needs to count. With one look, e is the viewing ray itself, and every
side serves equally; then the camera goes to its right (its x axis), and going to its left would do
as well. Directions are unit vectors from the object to the camera.

A direction is not taken if it lies within the least parallax of an earlier view, or more than
15 degrees below the present camera, as its own image has up and down: objects mostly stand on
something. Then, of directions on cones about the present one, the one is taken after which the
predicted position is known best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.pose.transforms import norms
from graspcast.views.association import position_covariance
from graspcast.views.camera_motion import CameraNoise
from graspcast.views.choice import MIN_PARALLAX_RAD, angles, viewing_directions
from graspcast.views.spread import DEFAULT_SPREAD, Spread

__all__ = [
    "MAX_TURN_RAD",
    "FurtherView",
    "NextLook",
    "further_view",
    "next_directions",
    "next_look",
    "next_looks",
]

MAX_TURN_RAD = float(np.deg2rad(60.0))
"""Farther to the side an estimator sees another face of the object, and a robot cannot often go."""

_MARGIN = 1.25
"""A robot does not reach a direction exactly, so more than the least parallax is asked for."""
_BELOW = float(np.sin(np.deg2rad(15.0)))
_PARALLEL = 0.1
"""Sine of the angle between axis and ray below which every side serves."""
_EQUAL = 0.98
"""Variances whose ratio is above this are equal: their axes are not known apart."""
_CONES, _AZIMUTHS = 4, 24
_X, _Y = np.eye(3)[:2]


@dataclass(frozen=True, eq=False)
class NextLook:
    """From where to look next.

    Attributes
    ----------
    direction
        From the object to the camera of the next look, a unit vector in the judged camera's frame,
        (3,). Any distance serves; about the present one is assumed.
    direction_world
        The same in the world's frame; None where the camera's pose in the world is not known.
    axis
        The direction in which the position is known worst, a unit vector in the judged camera's
        frame, (3,); it points away from the camera.
    axis_sd_m
        Standard deviation of the position along it, metres.
    angle_rad
        Between the present viewing direction and the next one, seen from the object.
    expected_probability
        The probability of success that is expected after that look; None where not forecast.
    """

    direction: Float[ndarray, "3"]
    direction_world: Float[ndarray, "3"] | None
    axis: Float[ndarray, "3"]
    axis_sd_m: float
    angle_rad: float
    expected_probability: float | None = None

    def __str__(self) -> str:
        known = self.direction_world is not None
        vector = self.direction_world if self.direction_world is not None else self.direction
        numbers = " ".join(f"{x:.2f}" for x in vector)
        frame = "world" if known else "camera"
        return (
            f"from {np.rad2deg(self.angle_rad):.0f} degrees to the side (direction {numbers} from "
            f"the object, {frame} frame)"
        )


@dataclass(frozen=True, eq=False)
class FurtherView:
    """What a further view of n instances would do to their fused poses, as a Kalman update.

    With an error e of the fused pose (position, rotation vector), it would be ``(I - gain) e + gain
    v`` after the view, where v is drawn from the normal distribution with covariance ``noise``.

    Attributes
    ----------
    covariance
        Of position (3, m) and rotation vector (3, rad) after it, camera's axes, (n, 6, 6).
    gain
        ``P inv(P + noise)``, P the covariance before it, (n, 6, 6).
    noise
        Covariance of what the view would say, (n, 6, 6).
    """

    covariance: Float[ndarray, "n 6 6"]
    gain: Float[ndarray, "n 6 6"]
    noise: Float[ndarray, "n 6 6"]


def further_view(
    covariance: Float[ndarray, "n 6 6"],
    cam_T_obj: Float[ndarray, "n 4 4"],
    direction: Float[ndarray, "n 3"],
    *,
    spread: Spread = DEFAULT_SPREAD,
    noise: CameraNoise | None = None,
    estimators: int = 1,
) -> FurtherView:
    """Predict what estimates from a further view at the same distance would do.

    Parameters
    ----------
    covariance
        Of the fused poses, in the judged camera's axes.
    cam_T_obj
        The fused poses, metres.
    direction
        From the object to the further camera, unit vectors in the judged camera's frame.
    spread
        Of an estimator.
    noise
        Of the camera motion; none by default.
    estimators
        How many estimate; the shared part of their variance remains.
    """
    noise = noise or CameraNoise()
    part = spread.shared + (1 - spread.shared) / max(1, estimators)
    sizes = np.sqrt(part) * np.array([spread.across, spread.along, spread.rotation_rad])
    R = np.zeros_like(covariance)
    # The covariance is the same along a ray and against it.
    there = direction * norms(cam_T_obj[:, :3, 3])
    R[:, :3, :3] = position_covariance(there, np.append(sizes, spread.shared), noise)
    R[:, 3:, 3:] = (sizes[2] ** 2 + noise.rotation_rad**2) * np.eye(3)
    # P inv(P + R) is the transpose of inv(P + R) P; the sum is never singular, since R is not.
    gain = np.swapaxes(np.linalg.solve(covariance + R, covariance), -1, -2)
    after = gain @ R
    return FurtherView((after + np.swapaxes(after, -1, -2)) / 2, gain, R)


def next_directions(
    cam_T_obj: Float[ndarray, "n 4 4"],
    covariance: Float[ndarray, "n 6 6"],
    *,
    cam_T_view: Float[ndarray, "n v 4 4"] | None = None,
    seen: Bool[ndarray, "n v"] | None = None,
    min_parallax_rad: float = MIN_PARALLAX_RAD,
    max_turn_rad: float = MAX_TURN_RAD,
) -> tuple[Float[ndarray, "n 3"], Float[ndarray, "n 3"], Float[ndarray, " n"]]:
    """Return where to look from next, the axes known worst, and the standard deviations along them.

    Parameters
    ----------
    cam_T_obj
        The fused poses in the judged camera's frame, metres.
    covariance
        Their covariances in the judged camera's axes.
    cam_T_view
        The cameras of the views there were, in the judged camera's frame; by default that of the
        judged image alone.
    seen
        Which of them there are.
    min_parallax_rad
        Least angle to every view there was.
    max_turn_rad
        Greatest angle to the present viewing direction.

    Raises
    ------
    InputError
        If a pose or covariance is not finite, or the angles leave nothing between them.
    """
    if not (np.isfinite(cam_T_obj).all() and np.isfinite(covariance).all()):
        raise InputError("next look: a pose or covariance holds numbers that are not finite")
    least = min_parallax_rad * _MARGIN
    if not 0 <= least <= max_turn_rad <= np.pi / 2:
        raise InputError(
            f"next look: the greatest turn should be {_MARGIN:g} times the least parallax or more, "
            f"and at most 90 degrees, not {np.rad2deg(max_turn_rad):g} degrees with "
            f"{np.rad2deg(min_parallax_rad):g}",
            parameters=("min_parallax",),
        )
    position = cam_T_obj[:, :3, 3]
    now = viewing_directions(position, np.zeros((len(position), 1, 3)))[:, 0]
    axis, deviation = _largest_axis(covariance[:, :3, :3], -now)
    views = now[:, None]
    if cam_T_view is not None:
        views = viewing_directions(position, cam_T_view[..., :3, 3])
        if seen is not None:
            views = np.where(seen[..., None], views, now[:, None])
    out = _perpendicular(now, axis, least, max_turn_rad)
    for i in np.flatnonzero(~_allowed(out[:, None], now, views, min_parallax_rad)[:, 0]).tolist():
        one = slice(i, i + 1)
        cones = _on_cones(now[i], least, max_turn_rad)
        allowed = _allowed(cones[None], now[one], views[one], min_parallax_rad)[0]
        if not allowed.any():  # views all around: the farthest from all of them
            gaps = angles(views[i], cones[:, None]).min(axis=1)
            out[i] = cones[gaps.argmax()]
            continue
        cones = cones[allowed]
        count = (len(cones), 1, 1)
        after = further_view(np.tile(covariance[i], count), np.tile(cam_T_obj[i], count), cones)
        worst = np.linalg.eigvalsh(after.covariance[:, :3, :3])[:, -1]
        # Of equally good ones the first, whatever the rounding.
        out[i] = cones[(worst <= worst.min() * (1 + 1e-6)).argmax()]
    return out, axis, deviation


def next_looks(
    cam_T_obj: Float[ndarray, "n 4 4"],
    covariance: Float[ndarray, "n 6 6"],
    *,
    cam_T_view: Float[ndarray, "n v 4 4"] | None = None,
    seen: Bool[ndarray, "n v"] | None = None,
    world_T_cam: Float[ndarray, "n 4 4"] | None = None,
    min_parallax_rad: float = MIN_PARALLAX_RAD,
    max_turn_rad: float = MAX_TURN_RAD,
) -> list[NextLook]:
    """Return from where to look next, for each of n instances.

    Parameters
    ----------
    cam_T_obj, covariance, cam_T_view, seen, min_parallax_rad, max_turn_rad
        As for :func:`next_directions`.
    world_T_cam
        The judged cameras' poses in the world, if known.

    Raises
    ------
    InputError
        As :func:`next_directions`.
    """
    direction, axis, deviation = next_directions(
        cam_T_obj,
        covariance,
        cam_T_view=cam_T_view,
        seen=seen,
        min_parallax_rad=min_parallax_rad,
        max_turn_rad=max_turn_rad,
    )
    centres = np.zeros((len(cam_T_obj), 1, 3))
    now = viewing_directions(cam_T_obj[:, :3, 3], centres)
    turn = angles(now, direction[:, None])[:, 0]
    return [
        NextLook(
            direction[i],
            None if world_T_cam is None else world_T_cam[i, :3, :3] @ direction[i],
            axis[i],
            float(deviation[i]),
            float(turn[i]),
        )
        for i in range(len(cam_T_obj))
    ]


def next_look(
    cam_T_obj: Float[ndarray, "4 4"],
    covariance: Float[ndarray, "6 6"],
    world_T_cam: Float[ndarray, "4 4"] | None = None,
    *,
    cam_T_view: Float[ndarray, "v 4 4"] | None = None,
    min_parallax_rad: float = MIN_PARALLAX_RAD,
    max_turn_rad: float = MAX_TURN_RAD,
) -> NextLook:
    """Return from where to look next at one instance; see :func:`next_looks`.

    Raises
    ------
    InputError
        As :func:`next_directions`.
    """
    (out,) = next_looks(
        cam_T_obj[None],
        covariance[None],
        cam_T_view=None if cam_T_view is None else cam_T_view[None],
        world_T_cam=None if world_T_cam is None else world_T_cam[None],
        min_parallax_rad=min_parallax_rad,
        max_turn_rad=max_turn_rad,
    )
    return out


def _largest_axis(
    covariance: Float[ndarray, "n 3 3"], ray: Float[ndarray, "n 3"]
) -> tuple[Float[ndarray, "n 3"], Float[ndarray, " n"]]:
    """Return the axis of largest variance; of several equal ones, the nearest to the ray."""
    values, vectors = np.linalg.eigh(covariance)
    largest = np.maximum(values[:, -1], 0.0)
    equal = values >= _EQUAL * largest[:, None]
    along = np.einsum("nij,ni->nj", vectors, ray)
    mixed = np.einsum("nij,nj->ni", vectors, np.where(equal, along, 0.0))
    length = norms(mixed)
    alone = vectors[..., -1]
    axis = np.where(length > _PARALLEL, mixed / np.maximum(length, _PARALLEL), alone)
    # An axis has no sign: the one away from the camera, or to the camera's right.
    sign = np.where(length[:, 0] > _PARALLEL, (axis * ray).sum(axis=1), axis[:, 0])
    return axis * np.where(sign < 0, -1.0, 1.0)[:, None], np.sqrt(largest)


def _perpendicular(
    now: Float[ndarray, "n 3"], axis: Float[ndarray, "n 3"], least: float, most: float
) -> Float[ndarray, "n 3"]:
    """Return the directions perpendicular to the axes that are nearest to the present ones."""
    flat = now - (now * axis).sum(axis=1, keepdims=True) * axis
    sine = norms(flat)
    beside = _sideways(now)
    nearest = np.where(sine < _PARALLEL, beside, flat / np.maximum(sine, _PARALLEL))
    needed = np.arccos(np.clip(sine[:, 0], 0.0, 1.0))
    towards = np.where(sine < _PARALLEL, beside, _across(nearest, now))
    turned = _turn(now, towards, np.minimum(needed, most))
    # Already nearly perpendicular: stay so, and move about the axis by the least parallax.
    about = np.cross(axis, nearest)
    about *= np.where((about * beside).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    moved = _turn(nearest, about, np.full(len(now), least))
    return np.where((needed < least)[:, None], moved, turned)


def _across(vector: ndarray, one: ndarray) -> Float[ndarray, "n 3"]:
    """Return the part of vectors across unit vectors, of length 1 (or 0)."""
    part = vector - (vector * one).sum(axis=-1, keepdims=True) * one
    return np.asarray(part / np.maximum(norms(part), 1e-12))


def _sideways(now: Float[ndarray, "n 3"]) -> Float[ndarray, "n 3"]:
    """Return the camera's right, perpendicular to the viewing directions."""
    edge_on = np.abs(now @ _X)[:, None] > 1 - 1e-9
    return _across(np.where(edge_on, -_Y, _X), now)


def _turn(one: ndarray, towards: ndarray, angle: ndarray) -> Float[ndarray, "n 3"]:
    out = np.cos(angle)[:, None] * one + np.sin(angle)[:, None] * towards
    return np.asarray(out / norms(out))


def _on_cones(now: Float[ndarray, "3"], least: float, most: float) -> Float[ndarray, "c 3"]:
    """Return directions about the present one, the camera's right first."""
    right = _sideways(now[None])[0]
    up = np.cross(now, right)
    azimuth = np.linspace(0, 2 * np.pi, _AZIMUTHS, endpoint=False)[:, None]
    towards = np.cos(azimuth) * right + np.sin(azimuth) * up
    turns = np.linspace(most, least, _CONES)
    around = [_turn(now[None], towards, np.full(_AZIMUTHS, turn)) for turn in turns]
    return np.concatenate(around)


def _allowed(
    directions: Float[ndarray, "n c 3"],
    now: Float[ndarray, "n 3"],
    views: Float[ndarray, "n v 3"],
    min_parallax_rad: float,
) -> Bool[ndarray, "n c"]:
    """Return which directions are far enough from all views, and not below the present camera."""
    gaps = angles(views[:, None], directions[:, :, None]).min(axis=-1)
    lower = (directions - now[:, None]) @ _Y
    return np.asarray((gaps >= min_parallax_rad) & (lower <= _BELOW))
