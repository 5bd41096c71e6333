"""``direct``: the pose is regressed from the crop, guided by a map of object coordinates.

The family of GDR-Net (Wang et al., CVPR 2021): rotation as two rows (Zhou et al., CVPR 2019),
seen along the ray to the crop; translation by place and apparent size in it.
"""

from __future__ import annotations

from os import PathLike

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.perception.crops import Crop
from graspcast.perception.network import CropEstimator, TrainedObject

__all__ = ["DirectEstimator", "load"]


class DirectEstimator(CropEstimator):
    """Rotation and translation by regression."""

    name = "direct"

    def solve(
        self,
        outputs: list[Float[ndarray, "..."]],
        crop: Crop,
        K: Float[ndarray, "3 3"],
        trained: TrainedObject,
    ) -> tuple[Float[ndarray, "4 4"], float] | None:
        """The regressed pose; the score is how sure the map is of where the object shows."""
        answer, drawn = outputs
        x, other = answer[:3], answer[3:6]
        x = x / np.linalg.norm(x)
        y = other - (x @ other) * x
        y = y / np.linalg.norm(y)
        rotation = np.stack([x, y, np.cross(x, y)])
        pose = crop.pose(rotation, answer[6:], K, trained.diameter_m)
        shown = 1 / (1 + np.exp(-drawn[-1]))
        sure = shown[shown > 0.5]
        return pose, float(sure.mean()) if len(sure) else 0.0


def load(weights: str | PathLike[str] | None = None) -> DirectEstimator:
    """The estimator with weights from a file, or those that ship."""
    return DirectEstimator(weights)
