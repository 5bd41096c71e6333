"""Columns of a visibility model: one estimator's own pose, its score, and image fit.

None needs another estimator, another view or ground truth.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.loading import Inputs
from graspcast.forecasting.features import Features
from graspcast.io.arguments import number, refuse_unless
from graspcast.pose.transforms import norms
from graspcast.views.fused_estimates import FusedEstimates

__all__ = [
    "POSE_COLUMNS",
    "SCORE_COLUMN",
    "features_of_one",
    "median_row",
    "seen_in_images",
    "seen_of",
    "visibility_features",
]

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


def features_of_one(estimates: Estimates, names: Sequence[str] | None = None) -> Features:
    """Compute the columns of a visibility model for one estimator's estimates.

    Parameters
    ----------
    estimates
        Poses by one estimator, with what :attr:`Estimates.seen` has of them.
    names
        The columns of the model that is asked, by default all there are. Those of image fit are
        left out if there are none.
    """
    seen = {name: values[0] for name, values in estimates.seen.items()}
    score = seen.pop(SCORE_COLUMN, None)
    wanted = tuple(seen) if names is None else tuple(names[len(POSE_COLUMNS) + 1 :])
    fit = None
    if any(name in seen for name in wanted):
        unknown = np.full(len(estimates), np.nan)
        fit = Features(wanted, np.stack([seen.get(name, unknown) for name in wanted], axis=1))
    return visibility_features(estimates.cam_T_obj[0], score, fit)


def seen_of(score: float | None, image_fit: Features | None) -> dict[str, Float[ndarray, "1 n"]]:
    """Return the score and image fit of one estimate as :attr:`Estimates.seen` has them.

    Raises
    ------
    InputError
        For an image fit of other than one instance, or a score that is no finite number.
    """
    out = {}
    if score is not None:
        refuse_unless(number(-1e12, 1e12), score, "a single view", "score")
        out[SCORE_COLUMN] = np.array([[float(score)]])
    if image_fit is not None:
        if len(image_fit.values) != 1:
            raise InputError(
                f"the image fit is of {len(image_fit.values)} instances; give that of the one "
                "that is asked for",
                parameters=("image_fit",),
            )
        out |= {n: image_fit.values[:, [i]] for i, n in enumerate(image_fit.names)}
    return out


def seen_in_images(inputs: Inputs, fused: FusedEstimates) -> dict[str, Float[ndarray, " n"]]:
    """Return score and image fit of a single estimator's estimates in the judged images."""
    poses, seen = fused.gathered.view_T_obj[:, 0].swapaxes(0, 1), {"score": fused.gathered.score.T}
    one = Estimates(fused.estimators, fused.instances, poses, seen=seen)
    return {name: values[0] for name, values in inputs.with_image_fit(one).seen.items()}


def median_row(values: Float[ndarray, "n d"]) -> Float[ndarray, " d"]:
    """Return the median of each column where it is known, 0 where it never is."""
    known = np.isfinite(values).any(axis=0)
    out = np.zeros(values.shape[1])
    out[known] = np.nanmedian(values[:, known], axis=0)
    return out
