"""``dense``: every cell of the crop says which point of the object it shows; PnP by RANSAC.

The family of EPOS (Hodan et al., CVPR 2020) and ZebraPose (Su et al., CVPR 2022): coordinates are
classified, not regressed, so that a cell may be of two minds without meaning the middle.
"""

from __future__ import annotations

from os import PathLike

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.perception.crops import Crop
from graspcast.perception.network import CropEstimator, TrainedObject
from graspcast.perception.pnp import pose_from_points

__all__ = ["DenseEstimator", "load"]

_SHOWN = 0.5
_FEWEST = 6
_THRESHOLD = 1.0
"""Of RANSAC, in cells."""


class DenseEstimator(CropEstimator):
    """Object coordinates for every cell, then PnP."""

    name = "dense"

    def solve(
        self,
        outputs: list[Float[ndarray, "..."]],
        crop: Crop,
        K: Float[ndarray, "3 3"],
        trained: TrainedObject,
    ) -> tuple[Float[ndarray, "4 4"], float] | None:
        """The pose that most cells agree with; the score is their share of those shown."""
        (logits,) = outputs
        cells = logits.shape[-1]
        shown = 1 / (1 + np.exp(-logits[-1])) > _SHOWN
        if shown.sum() < _FEWEST:
            return None
        coordinates = _expected(logits[:-1].reshape(3, -1, cells, cells)[:, :, shown])
        axis = (np.arange(cells) + 0.5) / cells - 0.5
        u, v = np.meshgrid(axis, axis)
        pixels = crop.to_image(np.stack([u[shown], v[shown]], axis=-1))
        points = trained.lower + coordinates.T * trained.size
        found = pose_from_points(pixels, points, K, _THRESHOLD * crop.side / cells)
        if found is None:
            return None
        pose, agree = found
        return pose, float(agree.mean())


def _expected(logits: Float[ndarray, "3 b n"]) -> Float[ndarray, "3 n"]:
    """Coordinates in the box (0 to 1): the mean over the likeliest bin and its two neighbours.

    The first and the last bin stand for the box's borders.
    """
    bins = logits.shape[1]
    best = logits.argmax(axis=1)
    near = np.clip(best[:, None] + np.array([-1, 0, 1])[None, :, None], 0, bins - 1)
    weight = np.exp(np.take_along_axis(logits, near, axis=1) - logits.max(axis=1)[:, None])
    # At a border of the box the bin there would count twice.
    weight[:, 0][best == 0] = 0.0
    weight[:, 2][best == bins - 1] = 0.0
    return (near * weight).sum(axis=1) / weight.sum(axis=1) / (bins - 1)


def load(weights: str | PathLike[str] | None = None) -> DenseEstimator:
    """The estimator with weights from a file, or those that ship."""
    return DenseEstimator(weights)
