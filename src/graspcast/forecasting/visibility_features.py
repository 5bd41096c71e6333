"""Columns of a visibility model: one estimator's own pose, its score, and image fit.

None needs another estimator, another view or ground truth.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.forecasting.features import Features
from graspcast.pose.transforms import norms

__all__ = ["POSE_COLUMNS", "SCORE_COLUMN", "typical_row", "visibility_features"]

POSE_COLUMNS = ("view_x", "view_y", "view_z", "distance", "image_x", "image_y")
"""Direction from the object to the camera in the object's frame; distance in metres; and where the
object's origin is in the image, as the x and y of the unit vector to it in the camera's frame."""

SCORE_COLUMN = "score"
"""The estimator's own score."""


def visibility_features(
    cam_T_obj: Float[ndarray, "n 4 4"],
    score: Float[ndarray, " n"] | None = None,
    fit: Features | None = None,
) -> Features:
    """Compute the columns of a visibility model.

    Parameters
    ----------
    cam_T_obj
        One estimator's poses, metres, (n, 4, 4).
    score
        Their scores, NaN where unknown, (n,); None if all are.
    fit
        Image fit (:attr:`graspcast.rendering.image_fit.ImageFit.features`), rows of NaN where there
        is none; None without images.
    """
    position = cam_T_obj[:, :3, 3]
    distance = norms(position)
    ray = position / np.where(distance > 0, distance, 1.0)
    view = -np.einsum("nij,ni->nj", cam_T_obj[:, :3, :3], ray)
    stated = np.full(len(cam_T_obj), np.nan) if score is None else score
    columns = [view, distance, ray[:, :2], stated[:, None].astype(np.float64)]
    names: tuple[str, ...] = (*POSE_COLUMNS, SCORE_COLUMN)
    if fit is not None:
        columns.append(fit.values)
        names += fit.names
    return Features(names, np.concatenate(columns, axis=1))


def typical_row(features: Features) -> Float[ndarray, " d"]:
    """Return the median of each column where it is known, 0 where it never is."""
    known = np.isfinite(features.values).any(axis=0)
    out = np.zeros(features.values.shape[1])
    out[known] = np.nanmedian(features.values[:, known], axis=0)
    return out
