"""Estimate of a single trial: a given error, or a row of a results CSV."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.dataset import GroundTruth
from graspcast.bop.results import Results
from graspcast.errors import InputError
from graspcast.estimates.alignment import rows_in_image
from graspcast.estimates.matching import match
from graspcast.pose.transforms import compose, invert, rotation_from_vector, transform

__all__ = ["estimate_in_image", "estimate_with_error"]


def estimate_with_error(offset: Sequence[float | int]) -> Float[ndarray, "4 4"]:
    """Return ``obj_T_est`` of an estimate with a given error.

    Parameters
    ----------
    offset
        Translation in the object's frame, mm, and rotation vector, degrees: six numbers.

    Raises
    ------
    InputError
        If a number is not finite.
    """
    values = np.array(offset, dtype=np.float64)
    if not np.isfinite(values).all():
        raise InputError(
            f"the offset {list(offset)} is not six finite numbers", parameters=("offset",)
        )
    return transform(rotation_from_vector(np.radians(values[3:])), values[:3] / 1000)


def estimate_in_image(
    results: Results, truth: GroundTruth, name: str, image: tuple[int, int], est_id: int
) -> Float[ndarray, "4 4"]:
    """Return ``obj_T_est`` of an estimate in an image, from its ground truth.

    Parameters
    ----------
    results
        Estimates of this object alone.
    truth
        Ground truth of the same dataset.
    name
        Name of the object, ``dataset-number``.
    image
        Scene and image number.
    est_id
        Number of the estimate among those of the object in the image, by descending score.

    Raises
    ------
    InputError
        If there is no such estimate, or it has no ground truth.
    """
    scene_id, im_id = image
    rows = rows_in_image(results, scene_id, im_id, name)
    if not 0 <= est_id < len(rows):
        raise InputError(
            f"estimate {est_id} of {name} in image {scene_id}/{im_id}: there are {len(rows)}, "
            "counted from 0",
            parameters=("est_id",),
        )
    matched = match(results, truth)[rows[est_id]]
    if matched < 0:
        raise InputError(
            f"{truth.source}: no ground truth for estimate {est_id} of {name} in image "
            f"{scene_id}/{im_id}",
            parameters=("ground_truth",),
        )
    return compose(invert(truth.cam_T_obj[matched]), results.cam_T_obj[rows[est_id]])
