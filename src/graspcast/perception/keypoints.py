"""The estimator ``keypoints``: a heat map per keypoint of the object, then PnP with RANSAC.

Like BB8 (Rad and Lepetit, ICCV 2017) and DOPE (Tremblay et al., CoRL 2018); the keypoints are
chosen on the surface by farthest-point sampling (Peng et al., *PVNet*, CVPR 2019).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.perception.crops import Crop
from graspcast.perception.network import CropEstimator
from graspcast.perception.pnp import pose_from_points
from graspcast.perception.trained_objects import TrainedObject

__all__ = ["KeypointEstimator", "heat_map_peaks"]

_WINDOW = 2
_CONFIDENT, _FEWEST = 0.3, 6
_THRESHOLD = 3.0
"""RANSAC's reprojection threshold, in cells."""


class KeypointEstimator(CropEstimator):
    """Sparse keypoints, then PnP with RANSAC."""

    name = "keypoints"

    def solve(
        self,
        outputs: list[Float[ndarray, "..."]],
        crop: Crop,
        K: Float[ndarray, "3 3"],
        trained: TrainedObject,
    ) -> tuple[Float[ndarray, "4 4"], float] | None:
        """Compute the pose; the score is the inliers' confidence, averaged over all keypoints."""
        (logits,) = outputs
        positions, confidence = heat_map_peaks(logits)
        # The confident keypoints, and at least the six most confident.
        chosen = confidence >= min(_CONFIDENT, np.sort(confidence)[-_FEWEST])
        threshold = _THRESHOLD * crop.side / logits.shape[-1]
        pixels = crop.to_image(positions[chosen])
        found = pose_from_points(pixels, trained.keypoints[chosen], K, threshold)
        if found is None:
            return None
        pose, agree = found
        return pose, float(confidence[chosen][agree].sum() / len(confidence))


def heat_map_peaks(
    logits: Float[ndarray, "k s s"],
) -> tuple[Float[ndarray, "k 2"], Float[ndarray, " k"]]:
    """Locate the peak of each heat map with subcell precision.

    Returns
    -------
    Coordinates in the crop from -0.5 to 0.5, (k, 2), and confidence, (k,): the share of the map's
    probability within two cells of its maximum.
    """
    count, cells = logits.shape[0], logits.shape[-1]
    heat = np.exp(logits - logits.max(axis=(1, 2), keepdims=True))
    heat /= heat.sum(axis=(1, 2), keepdims=True)
    row, column = np.unravel_index(heat.reshape(count, -1).argmax(axis=1), (cells, cells))
    axis = np.arange(cells)
    near = (np.abs(axis - row[:, None]) <= _WINDOW)[:, :, None] & (
        np.abs(axis - column[:, None]) <= _WINDOW
    )[:, None, :]
    heat = np.where(near, heat, 0.0)
    confidence = heat.sum(axis=(1, 2))
    x, y = (heat.sum(axis=1) @ axis) / confidence, (heat.sum(axis=2) @ axis) / confidence
    return (np.stack([x, y], axis=-1) + 0.5) / cells - 0.5, confidence
