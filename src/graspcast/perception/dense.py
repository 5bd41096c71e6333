"""The estimator ``dense``: object coordinates per cell of the crop, then PnP with RANSAC.

Like EPOS (Hodan et al., CVPR 2020) and ZebraPose (Su et al., CVPR 2022) it classifies coordinates
instead of regressing them, so that a cell can predict two distant points without their mean.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.perception.crops import Crop
from graspcast.perception.network import CropEstimator
from graspcast.perception.pnp import pose_from_points
from graspcast.perception.trained_objects import TrainedObject

__all__ = ["DenseEstimator", "expected_coordinates"]

_SHOWN = 0.5
_FEWEST = 6
_THRESHOLD = 1.0
"""RANSAC's reprojection threshold, in cells."""


class DenseEstimator(CropEstimator):
    """Dense 2D-3D correspondences, then PnP with RANSAC."""

    name = "dense"

    def solve(
        self,
        outputs: list[Float[ndarray, "..."]],
        crop: Crop,
        K: Float[ndarray, "3 3"],
        trained: TrainedObject,
    ) -> tuple[Float[ndarray, "4 4"], float] | None:
        """Compute the pose; the score is the share of inliers among the object's cells."""
        (logits,) = outputs
        cells = logits.shape[-1]
        shown = 1 / (1 + np.exp(-logits[-1])) > _SHOWN
        if shown.sum() < _FEWEST:
            return None
        coordinates = expected_coordinates(logits[:-1].reshape(3, -1, cells, cells)[:, :, shown])
        axis = (np.arange(cells) + 0.5) / cells - 0.5
        u, v = np.meshgrid(axis, axis)
        pixels = crop.to_image(np.stack([u[shown], v[shown]], axis=-1))
        points = trained.lower + coordinates.T * trained.size
        found = pose_from_points(pixels, points, K, _THRESHOLD * crop.side / cells)
        if found is None:
            return None
        pose, agree = found
        return pose, float(agree.mean())


def expected_coordinates(logits: Float[ndarray, "3 b n"]) -> Float[ndarray, "3 n"]:
    """Compute coordinates in the object's box as a mean over the likeliest bin and its neighbours.

    Parameters
    ----------
    logits
        Of each axis, bin and cell.

    Returns
    -------
    Coordinates from 0 to 1 of each axis and cell; the first and last bins are the box's borders.
    """
    bins = logits.shape[1]
    best = logits.argmax(axis=1)
    near = np.clip(best[:, None] + np.array([-1, 0, 1])[None, :, None], 0, bins - 1)
    weight = np.exp(np.take_along_axis(logits, near, axis=1) - logits.max(axis=1)[:, None])
    # np.clip repeats the bin at a border of the box.
    weight[:, 0][best == 0] = 0.0
    weight[:, 2][best == bins - 1] = 0.0
    return (near * weight).sum(axis=1) / weight.sum(axis=1) / (bins - 1)
