"""Pose from points whose places in the image are known, most of them rightly (PnP by RANSAC)."""

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
    """``cam_T_obj``, and which points agree with it; None if there is no such pose.

    PoseLib's RANSAC (Larsson, 2020), which is seeded, then its refinement by the robust
    reprojection error of all that agree.

    Parameters
    ----------
    pixels
        Where each point is seen.
    points
        The points in the object's frame, metres; at least four.
    K
        Intrinsics.
    threshold_px
        How far a point may be seen from where the pose puts it.
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
    # Millimetres, because PoseLib's tolerances are made for numbers about one and above.
    pose, about = poselib.estimate_absolute_pose(
        pixels, 1000.0 * points, camera, {"max_reproj_error": threshold_px, "seed": 0}, {}
    )
    agree = np.array(about["inliers"], dtype=bool)
    if agree.sum() < 4:
        return None
    rotation = project_to_rotation(np.asarray(pose.R, dtype=np.float64))
    return transform(rotation, np.asarray(pose.t, dtype=np.float64) / 1000.0), agree
