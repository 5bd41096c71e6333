"""Checks of ground truth: rotations, positions before the camera, distances and outlines."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from os import PathLike

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.bop.rotations import MAX_ROTATION_DEVIATION, checked_rotations
from graspcast.bop.unit_checks import distance_problem, outline_problem
from graspcast.errors import FormatError
from graspcast.pose.lengths import shown
from graspcast.pose.sanity import rotation_problem

__all__ = ["check_outlines", "check_true_poses"]

_MOST_OUTLINES = 200
_LEAST_VISIBLE = 0.1


def check_true_poses(
    path: str | PathLike[str],
    instances: Int[ndarray, "n 2"],
    rotation: Float[ndarray, "n 3 3"],
    position_m: Float[ndarray, "n 3"],
    visib_fract: Float[ndarray, " n"],
    diameters_m: Mapping[int, float] | None = None,
) -> None:
    """Raise unless the true poses of a scene can be those of objects that a camera sees.

    Parameters
    ----------
    path
        The scene's ``scene_gt.json``, for messages.
    instances
        Image and object of each instance, (n, 2).
    rotation, position_m
        ``cam_R_m2c`` and ``cam_t_m2c``, in metres as read in millimetres.
    visib_fract
        Visible fractions, NaN where unknown, (n,).
    diameters_m
        Object's number to its diameter, metres.

    Raises
    ------
    FormatError
        Naming image and object, or the median distance and the unit that would fit.
    """
    if not len(rotation):
        return

    def where(i: int) -> str:
        return f"image {instances[i, 0]}, object {instances[i, 1]}"

    _, deviation = checked_rotations(rotation)
    if (deviation > MAX_ROTATION_DEVIATION).any():
        worst = int(np.argmax(deviation))
        raise FormatError(
            path,
            f"cam_R_m2c is {deviation[worst]:.3g} away from the nearest rotation matrix: it "
            f"{rotation_problem(rotation[worst])}",
            where=where(worst),
        )
    behind = position_m[:, 2] <= 0
    # Rendered datasets list objects outside the image too, some behind the camera.
    wrong = behind & ((visib_fract > 0) | (behind.mean() > 0.5))
    if wrong.any():
        first = int(np.flatnonzero(wrong)[0])
        raise FormatError(
            path,
            f"the object is behind the camera (its z is {shown(float(position_m[first, 2]))}), as "
            f"{int(behind.sum())} of {len(behind)} here; BOP's camera looks along +z, with y down",
            where=where(first),
        )
    sizes = np.array([(diameters_m or {}).get(i, np.nan) for i in instances[:, 1].tolist()])
    distance = np.linalg.norm(position_m, axis=1)
    if problem := distance_problem("cam_t_m2c", distance[~behind], sizes[~behind]):
        raise FormatError(path, problem, parameters=("ground_truth",))


def check_outlines(
    source: str,
    instances: Int[ndarray, "n 3"],
    depth_m: Float[ndarray, " n"],
    visib_fract: Float[ndarray, " n"],
    box_xywh: Float[ndarray, "n 4"],
    *,
    diameters_m: Mapping[int, float],
    focal_px: Callable[[int, int], float],
) -> None:
    """Raise unless objects of these sizes, this far away, look as large as their boxes.

    Parameters
    ----------
    source
        The ground truth, for messages.
    instances
        Scene, image and object of each instance, (n, 3).
    depth_m, visib_fract, box_xywh
        Depth, visible fraction and ``bbox_obj`` of each instance, NaN where unknown.
    diameters_m
        Object's number to its diameter, metres.
    focal_px
        Returns the focal length of an image, by scene and image, NaN where unknown.

    Raises
    ------
    FormatError
        Naming the median distance, and the one that boxes, camera and diameters imply.
    """
    longer = box_xywh[:, 2:].max(axis=1)
    sizes = np.array([diameters_m.get(i, np.nan) for i in instances[:, 2].tolist()])
    rows = np.flatnonzero(
        (longer > 0) & ~(visib_fract < _LEAST_VISIBLE) & np.isfinite(sizes) & (depth_m > 0)
    )
    rows = rows[:: max(1, len(rows) // _MOST_OUTLINES)]
    focal = np.array([focal_px(*image) for image in instances[rows, :2].tolist()])
    rows, focal = rows[np.isfinite(focal)], focal[np.isfinite(focal)]
    if problem := outline_problem(depth_m[rows], longer[rows], sizes[rows], focal):
        raise FormatError(source, problem, parameters=("ground_truth",))
