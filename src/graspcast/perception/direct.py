"""The estimator ``direct``: the pose is regressed from the crop via a map of object coordinates.

Like GDR-Net (Wang et al., CVPR 2021) it predicts the allocentric rotation as two rows of the matrix
(Zhou et al., CVPR 2019) and the scale-invariant translation (SITE).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.perception.crops import Crop
from graspcast.perception.network import CropEstimator
from graspcast.perception.trained_objects import TrainedObject

__all__ = ["DirectEstimator"]


class DirectEstimator(CropEstimator):
    """Direct regression of rotation and translation."""

    name = "direct"

    def solve(
        self,
        outputs: list[Float[ndarray, "..."]],
        crop: Crop,
        K: Float[ndarray, "3 3"],
        trained: TrainedObject,
    ) -> tuple[Float[ndarray, "4 4"], float] | None:
        """Return the regressed pose; the score is the mean mask probability over the object."""
        answer, maps = outputs
        x, other = answer[:3], answer[3:6]
        x = x / np.linalg.norm(x)
        y = other - (x @ other) * x
        y = y / np.linalg.norm(y)
        rotation = np.stack([x, y, np.cross(x, y)])
        pose = crop.decode_pose(rotation, answer[6:], K, trained.diameter_m)
        mask = 1 / (1 + np.exp(-maps[-1]))
        confidence = mask[mask > 0.5]
        return pose, float(confidence.mean()) if len(confidence) else 0.0
