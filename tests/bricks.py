"""A box with a mesh, and grasps of it from above."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.simulation.objects.types import GraspObject
from solids import box


def brick() -> GraspObject:
    """A box with a mesh: 50 x 90 x 70 mm, so that only x fits between parallel fingers."""
    thing = box(0.05, 0.09, 0.07)
    half = np.array([0.05, 0.09, 0.07]) / 2
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return replace(thing, vertices=corners, faces=np.array(faces))


def from_top(depth_m: float) -> Float[ndarray, "4 4"]:
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0])
    pose[2, 3] = 0.035 - depth_m
    return pose
