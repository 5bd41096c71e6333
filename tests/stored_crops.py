"""Two boxes to train for, and stored crops of them as rendering makes them, of noise."""

from __future__ import annotations

import numpy as np

from graspcast.bop.models import ModelInfo
from graspcast.pose.transforms import rotation_from_vector, transform
from graspcast.rendering.synthetic.camera import INTRINSICS as K
from graspcast.rendering.synthetic.tabletop import ColouredMesh
from graspcast.training.objects import Objects
from graspcast.training.samples import STORED_CELLS, STORED_PIXELS
from poses import random_poses

SIZE = np.array([0.08, 0.06, 0.16])
DIAMETER_M = float(np.linalg.norm(SIZE))


class Boxes:
    """Stands for a directory of models: boxes, the second with a half turn about z."""

    def __init__(self) -> None:
        turn = transform(rotation_from_vector(np.array([0, 0, np.pi])), np.zeros(3))
        self.info = {
            1: ModelInfo(1, DIAMETER_M, -SIZE / 2, SIZE, np.zeros((0, 4, 4))),
            5: ModelInfo(5, DIAMETER_M, -SIZE / 2, SIZE, turn[None]),
        }

    def __getitem__(self, obj_id: int) -> ModelInfo:
        return self.info[obj_id]


def boxes() -> Objects:
    """Return two boxes, 1 and 5."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.5, 0.5, (400, 3)) * SIZE
    mesh = ColouredMesh(points, np.zeros((0, 3), dtype=np.int64), np.zeros((400, 3), np.uint8))
    return Objects("boxes", {1: mesh, 5: mesh}, Boxes())  # type: ignore[arg-type]


def raw(n: int = 16) -> dict[str, np.ndarray]:
    """Return stored crops."""
    rng = np.random.default_rng(1)
    poses = random_poses(n, 2, depth_m=0.8)
    pixels = poses[:, :3, 3] @ K.T
    crop = np.column_stack([pixels[:, :2] / pixels[:, 2:], rng.uniform(150, 250, n)])
    return {
        "image": rng.integers(0, 256, (n, STORED_PIXELS, STORED_PIXELS, 3), dtype=np.uint8),
        "coordinates": rng.integers(0, 256, (n, STORED_CELLS, STORED_CELLS, 3), dtype=np.uint8),
        "mask": rng.random((n, STORED_CELLS, STORED_CELLS)) < 0.5,
        "object": np.arange(n) % 2,
        "cam_T_obj": poses,
        "crop": crop,
    }
