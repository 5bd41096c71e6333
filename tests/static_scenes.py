"""A static scene seen by a camera that moves around it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy import ndarray

from graspcast.bop.results import Results
from graspcast.pose.ray_frame import displaced
from graspcast.pose.transforms import invert, rotation_from_vector, transform
from graspcast.views.camera_motion import CameraMotion


def orbit(images: int = 12, *, degrees: float = 15.0, radius_m: float = 0.8) -> ndarray:
    """``world_T_cam`` of cameras that look at the origin from 40 degrees above, (images, 4, 4)."""
    out = []
    for angle in np.deg2rad(degrees) * np.arange(images):
        height = np.deg2rad(40.0)
        away = np.array(
            [np.cos(angle) * np.cos(height), np.sin(angle) * np.cos(height), np.sin(height)]
        )
        z = -away
        x = np.cross(z, [0.0, 0.0, 1.0])
        x /= np.linalg.norm(x)
        out.append(transform(np.stack([x, np.cross(z, x), z], axis=1), radius_m * away))
    return np.stack(out)


def motion_of(cameras: ndarray, scene_id: int = 1) -> CameraMotion:
    return CameraMotion.of([scene_id] * len(cameras), list(range(len(cameras))), cameras)


def objects(n: int = 4, seed: int = 0) -> ndarray:
    """``world_T_obj`` of n objects near the origin, (n, 4, 4)."""
    rng = np.random.default_rng(seed)
    return transform(
        rotation_from_vector(rng.normal(size=(n, 3))), rng.uniform(-0.12, 0.12, size=(n, 3))
    )


def seen(cameras: ndarray, world_T_obj: ndarray) -> ndarray:
    """True ``cam_T_obj``, (images, n, 4, 4)."""
    return np.asarray(invert(cameras)[:, None] @ world_T_obj[None])


def scattered(poses: ndarray, seed: int, sizes: Sequence[float] = (0.003, 0.012, 0.07)) -> ndarray:
    """Poses with normal errors across (each axis) and along the ray, and of the rotation."""
    rng = np.random.default_rng(seed)
    across, along, turn = sizes
    size = np.array([across, across, along, turn, turn, turn])
    return np.asarray(displaced(poses, rng.normal(size=(*poses.shape[:-2], 6)) * size))


def estimates_of(
    poses: ndarray, *, scene_id: int = 1, obj_ids: Sequence[int] | None = None
) -> Results:
    """Results of (images, n, 4, 4) poses: one row an image and object; image numbers from 0."""
    images, n = poses.shape[:2]
    numbers = list(range(1, n + 1)) if obj_ids is None else list(obj_ids)
    return Results(
        scene_id=np.full(images * n, scene_id),
        im_id=np.repeat(np.arange(images), n),
        obj_id=np.tile(numbers, images),
        score=np.linspace(1, 0.5, images * n),
        cam_T_obj=poses.reshape(-1, 4, 4),
        time_s=np.full(images * n, -1.0),
        line=np.arange(images * n) + 2,
    )
