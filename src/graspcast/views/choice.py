"""Choice of views: which other images of a scene serve, spread by parallax."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.pose.transforms import norms
from graspcast.views.camera_motion import CameraNoise

__all__ = [
    "MIN_PARALLAX_RAD",
    "ViewRules",
    "ViewsFrom",
    "angles",
    "choose_views",
    "viewing_directions",
]

ViewsFrom = Literal["earlier", "all"]
"""Which images may serve: those with a smaller ``im_id``, or all others."""

MIN_PARALLAX_RAD = float(np.deg2rad(12.0))
"""Views nearer than this share most of the error along the ray, and help little."""


@dataclass(frozen=True)
class ViewRules:
    """Which other images serve.

    Attributes
    ----------
    views_from
        Earlier images alone, or all.
    max_views
        At most this many, the judged one included.
    min_parallax_rad
        Least angle between any two.
    noise
        Of the camera motion, beside what the motion itself states.
    images
        The images (scene_id, im_id) whose instances are wanted; None for all.
    without
        Objects in images (scene_id, im_id, obj_id) whose instances are not wanted.
    """

    views_from: ViewsFrom
    max_views: int
    min_parallax_rad: float
    noise: CameraNoise
    images: frozenset[tuple[int, int]] | None = None
    without: frozenset[tuple[int, int, int]] = frozenset()


def viewing_directions(
    position: Float[ndarray, "*batch 3"], centres: Float[ndarray, "*batch m 3"]
) -> Float[ndarray, "*batch m 3"]:
    """Return unit vectors from an object to the cameras, all in one frame."""
    towards = centres - position[..., None, :]
    return towards / np.maximum(norms(towards), 1e-12)


def choose_views(
    judged: Float[ndarray, "3"],
    others: Float[ndarray, "m 3"],
    most: int,
    min_parallax_rad: float = MIN_PARALLAX_RAD,
) -> Int[ndarray, " v"]:
    """Choose views, each the farthest from those chosen before, in angles at the object.

    Parameters
    ----------
    judged
        Direction from the object to the judged image's camera, a unit vector.
    others
        Directions to the other cameras.
    most
        At most this many are chosen.
    min_parallax_rad
        Each lies at least this far from the judged view and from every other one.

    Returns
    -------
    Numbers among ``others``; of equal ones the first.
    """
    chosen: list[int] = []
    nearest = angles(others, judged)
    while len(chosen) < min(most, len(others)):
        best = int(nearest.argmax())
        if nearest[best] < max(min_parallax_rad, 1e-9):
            break
        chosen.append(best)
        nearest = np.minimum(nearest, angles(others, others[best]))
    return np.array(chosen, dtype=np.int64)


def angles(
    directions: Float[ndarray, "*#batch 3"], one: Float[ndarray, "*#batch 3"]
) -> Float[ndarray, "*batch"]:
    """Return the angles between unit vectors; accurate for small ones, unlike arccos."""
    half = norms(directions - one)[..., 0] / 2
    return np.asarray(2 * np.arcsin(np.minimum(half, 1.0)))
