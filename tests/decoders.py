"""Network outputs for known poses, and decoders without a network, for tests of estimators."""

from __future__ import annotations

import numpy as np

from graspcast.perception.crops import Crop
from graspcast.perception.network import CropEstimator
from graspcast.perception.trained_objects import TrainedObject
from graspcast.pose.transforms import rotation_angle

K = np.array([[572.4, 0.0, 325.3], [0.0, 573.6, 242.0], [0.0, 0.0, 1.0]])
RNG = np.random.default_rng(0)
TRAINED = TrainedObject(
    obj_id=3,
    diameter_m=0.25,
    lower=np.array([-0.05, -0.04, -0.1]),
    size=np.array([0.1, 0.08, 0.2]),
    keypoints=RNG.uniform(-1, 1, (12, 3)) * [0.05, 0.04, 0.1],
)
BINS, CELLS = 16, 16


def estimator(kind: type[CropEstimator]) -> CropEstimator:
    """Without a network, which these tests play themselves."""
    return kind.__new__(kind)


def off(pose: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Degrees and millimetres."""
    turn = np.degrees(rotation_angle(true[:3, :3].T @ pose[:3, :3]))
    return float(turn), float(1e3 * np.linalg.norm(pose[:3, 3] - true[:3, 3]))


def crop_around(pose: np.ndarray) -> Crop:
    u, v, z = K @ pose[:3, 3]
    return Crop(u / z + 5, v / z - 7, 1.2 * 572 * 0.25 / z)


def ellipsoid(pose: np.ndarray, crop: Crop) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates in the box that each cell's ray meets on an ellipsoid in it, and whether."""
    axis = (np.arange(CELLS) + 0.5) / CELLS - 0.5
    u, v = np.meshgrid(axis, axis)
    pixels = crop.to_image(np.stack([u, v], axis=-1))
    rays = np.concatenate([pixels, np.ones((CELLS, CELLS, 1))], axis=-1) @ np.linalg.inv(K).T
    R, t, radius = pose[:3, :3], pose[:3, 3], TRAINED.size / 2
    d, o = rays @ R / radius, -(R.T @ t) / radius
    a, b, c = (d * d).sum(-1), (d * o).sum(-1), o @ o - 1
    under = b * b - a * c
    hit = under > 0
    depth = (-b - np.sqrt(np.where(hit, under, 0.0))) / a
    return np.moveaxis((o + depth[..., None] * d) / 2 + 0.5, -1, 0), hit


def logits_of(coordinates: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """Logits that mean just these coordinates, shared by the two nearest bins."""
    place = np.clip(coordinates, 0, 1) * (BINS - 1)
    lower = np.clip(np.floor(place), 0, BINS - 2).astype(int)
    weight = np.full((3, BINS, CELLS, CELLS), 1e-9)
    for k, share in ((0, 1 - (place - lower)), (1, place - lower)):
        np.put_along_axis(weight, (lower + k)[:, None], share[:, None] + 1e-9, axis=1)
    mask = np.where(shown, 8.0, -8.0)[None]
    return np.concatenate([np.log(weight).reshape(-1, CELLS, CELLS), mask])


def heat(places: np.ndarray, cells: int = 32) -> np.ndarray:
    """Logits of a bump about each place."""
    centre = (places + 0.5) * cells - 0.5
    axis = np.arange(cells)
    x, y = (axis - centre[:, :1]) ** 2, (axis - centre[:, 1:]) ** 2
    return -0.5 * (x[:, None, :] + y[:, :, None])
