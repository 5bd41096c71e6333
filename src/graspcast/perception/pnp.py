"""Pose from 2D-3D correspondences with outliers: PnP with RANSAC."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.pose.transforms import project_to_rotation, transform

__all__ = ["pose_from_points"]


def pose_from_points(
    pixels: Float[ndarray, "n 2"],
    points: Float[ndarray, "n 3"],
    K: Float[ndarray, "3 3"],
    threshold_px: float,
) -> tuple[Float[ndarray, "4 4"], Bool[ndarray, " n"]] | None:
    """Estimate a pose from 2D-3D correspondences by PnP with RANSAC.

    PoseLib (Larsson, 2020): RANSAC with a fixed seed, then refinement of the robust reprojection
    error over the inliers.

    Parameters
    ----------
    pixels
        Image coordinates of the points.
    points
        The points in the object's frame, metres; at least four.
    K
        Intrinsics, pixels.
    threshold_px
        Largest reprojection error of an inlier, pixels.

    Returns
    -------
    ``cam_T_obj`` and a mask of the inliers; None if fewer than four points are inliers.
    """
    import poselib

    if len(points) < 4:
        return None
    camera = {
        "model": "PINHOLE",
        "width": 0,
        "height": 0,
        "params": [K[0, 0], K[1, 1], K[0, 2], K[1, 2]],
    }
    # Millimetres, because PoseLib's tolerances suit coordinates of about one and above.
    pose, about = poselib.estimate_absolute_pose(
        pixels, 1000.0 * points, camera, {"max_reproj_error": threshold_px, "seed": 0}, {}
    )
    agree = np.array(about["inliers"], dtype=bool)
    if agree.sum() < 4:
        return None
    rotation = project_to_rotation(np.asarray(pose.R, dtype=np.float64))
    return transform(rotation, np.asarray(pose.t, dtype=np.float64) / 1000.0), agree
