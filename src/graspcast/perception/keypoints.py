"""``keypoints``: a heat map for each of a few points on the object; PnP by RANSAC.

The family of BB8 (Rad and Lepetit, ICCV 2017) and DOPE (Tremblay et al., CoRL 2018); the points lie
on the surface, far from each other (Peng et al., PVNet, CVPR 2019).
"""

from __future__ import annotations

from os import PathLike

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.perception.crops import Crop
from graspcast.perception.network import CropEstimator, TrainedObject
from graspcast.perception.pnp import pose_from_points

__all__ = ["KeypointEstimator", "load"]

_WINDOW = 2
_SURE, _FEWEST = 0.3, 6
_THRESHOLD = 3.0
"""Of RANSAC, in cells."""


class KeypointEstimator(CropEstimator):
    """Keypoints, then PnP."""

    name = "keypoints"

    def solve(
        self,
        outputs: list[Float[ndarray, "..."]],
        crop: Crop,
        K: Float[ndarray, "3 3"],
        trained: TrainedObject,
    ) -> tuple[Float[ndarray, "4 4"], float] | None:
        """The pose that most keypoints agree with; the score is their share of the certainty."""
        (logits,) = outputs
        places, sure = _peaks(logits)
        # Those that are where they seem to be, and at least the likeliest six.
        chosen = sure >= min(_SURE, np.sort(sure)[-_FEWEST])
        threshold = _THRESHOLD * crop.side / logits.shape[-1]
        pixels = crop.to_image(places[chosen])
        found = pose_from_points(pixels, trained.keypoints[chosen], K, threshold)
        if found is None:
            return None
        pose, agree = found
        return pose, float(sure[chosen][agree].sum() / len(sure))


def _peaks(logits: Float[ndarray, "k s s"]) -> tuple[Float[ndarray, "k 2"], Float[ndarray, " k"]]:
    """Each map's peak (-0.5 to 0.5 each way), and the share of the map that lies about it."""
    count, cells = logits.shape[0], logits.shape[-1]
    heat = np.exp(logits - logits.max(axis=(1, 2), keepdims=True))
    heat /= heat.sum(axis=(1, 2), keepdims=True)
    row, column = np.unravel_index(heat.reshape(count, -1).argmax(axis=1), (cells, cells))
    axis = np.arange(cells)
    near = (np.abs(axis - row[:, None]) <= _WINDOW)[:, :, None] & (
        np.abs(axis - column[:, None]) <= _WINDOW
    )[:, None, :]
    heat = np.where(near, heat, 0.0)
    sure = heat.sum(axis=(1, 2))
    x, y = (heat.sum(axis=1) @ axis) / sure, (heat.sum(axis=2) @ axis) / sure
    return (np.stack([x, y], axis=-1) + 0.5) / cells - 0.5, sure


def load(weights: str | PathLike[str] | None = None) -> KeypointEstimator:
    """The estimator with weights from a file, or those that ship."""
    return KeypointEstimator(weights)
