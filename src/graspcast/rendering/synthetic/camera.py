"""Random camera poses and lights of a synthetic scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.pose.transforms import rotation_from_vector, transform

__all__ = ["INTRINSICS", "Light", "View", "random_view"]

INTRINSICS = np.array([[572.4114, 0.0, 325.2611], [0.0, 573.57043, 242.04899], [0.0, 0.0, 1.0]])
"""Intrinsics of LM-O, for images of 640 x 480 pixels."""

_DISTANCE_M = (0.5, 1.1)
_ELEVATION_DEG = (20.0, 80.0)


@dataclass(frozen=True)
class Light:
    """Ambient light, and light from up to three directions in the world frame.

    Attributes
    ----------
    ambient
        Strength of the ambient light, RGB, (3,).
    directions
        Unit vectors along which light falls, (3, 3).
    strengths
        RGB strength of each direction, (3, 3); zero for none.
    sky
        Colour of the background beyond the table, RGB from 0 to 255, (3,).
    """

    ambient: Float[ndarray, " 3"]
    directions: Float[ndarray, "3 3"]
    strengths: Float[ndarray, "3 3"]
    sky: Float[ndarray, " 3"]


@dataclass(frozen=True)
class View:
    """A camera pose (OpenCV: x right, y down, z forward) and the light.

    Attributes
    ----------
    sim_T_cam
        The camera's pose in the table's frame.
    light
        The light.
    """

    sim_T_cam: Float[ndarray, "4 4"]
    light: Light


def random_view(rng: np.random.Generator, about: Float[ndarray, " 3"]) -> View:
    """Sample a view of a point (metres), from above the table at a distance of 0.5 to 1.1 m."""
    target = about + rng.normal(0, 0.03, 3)
    azimuth = rng.uniform(-np.pi, np.pi)
    elevation = np.radians(rng.uniform(*_ELEVATION_DEG))
    away = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    forward = -away
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    level = np.stack([right, np.cross(forward, right), forward], axis=-1)
    roll = rotation_from_vector(np.array([0.0, 0.0, rng.normal(0, np.radians(8))]))
    position = target + rng.uniform(*_DISTANCE_M) * away
    return View(transform(level @ roll, position), _random_light(rng))


def _random_light(rng: np.random.Generator) -> Light:
    directions = rng.normal(size=(3, 3))
    directions[:, 2] = -np.abs(directions[:, 2]) - 0.3
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    tint = rng.uniform(0.85, 1.0, (4, 3))
    strengths = rng.uniform(0.15, 0.6, (3, 1)) * (np.arange(3)[:, None] < rng.integers(1, 4))
    sky = np.clip(rng.uniform(40, 240) + rng.normal(0, 15, 3), 0, 255)
    return Light(rng.uniform(0.3, 0.65) * tint[3], directions, strengths * tint[:3], sky)
