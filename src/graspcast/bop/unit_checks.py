"""Checks of the unit of length in BOP's files: distances, diameters and meshes against each other.

BOP's files are in millimetres. Metres, centimetres and inches give smaller numbers, so of two
lengths that contradict each other the smaller one is taken to be in another unit.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.pose.lengths import METRES, UNIT_NAMES, Reference, between, shown, unit_problem
from graspcast.pose.sanity import USUAL_DIAMETERS, distance_reference

__all__ = [
    "camera_problem",
    "diameter_problem",
    "distance_problem",
    "mesh_problem",
    "models_problem",
    "outline_problem",
    "ratio_problem",
    "symmetry_problem",
]

_SEEN_M = (0.05, 20.0)
"""Between which objects are seen by a camera, metres."""

_MEDIAN_DIAMETERS = (1.0, 50.0)
"""The median distance, in diameters; LM-O 6.5, YCB-V 4.6. Nearer, an object exceeds the image."""

_GRASPED_M = (0.005, 1.0)
"""The size of what a hand grasps, metres."""

_LOOSE = 1.25
"""How much models_info.json and a mesh may differ, since meshes are simplified."""

_AGREEING = 3.0
"""By which factor two median distances of the same objects in the same images may differ."""


def _problem(what: str, length_m: float, reference: Reference, unit: str = "mm") -> str:
    """Word the problem of a length that was read in a unit, with the remedy."""
    said = unit_problem(what, length_m, reference, unit=unit)
    if unit != "mm" or not said.endswith("?"):
        return said
    return f"{said} Convert it: BOP's files are in millimetres"


def distance_problem(
    what: str,
    distance_m: Float[ndarray, " n"],
    diameter_m: Float[ndarray, " n"] | None = None,
    *,
    unit: str = "mm",
) -> str:
    """Say how the distances of objects contradict their diameters, or what a camera can see.

    Parameters
    ----------
    what
        The lengths in words, for example ``"t"``.
    distance_m
        Distances from the camera, metres, as read in ``unit``.
    diameter_m
        The objects' diameters, NaN where unknown.
    unit
        The unit in which the distances were read.

    Returns
    -------
        The problem, with both numbers and the unit that would fit; empty if there is none.
    """
    if not len(distance_m):
        return ""
    what, median = f"the median distance of {what}", float(np.median(distance_m))
    known = np.zeros(len(distance_m), dtype=bool) if diameter_m is None else ~np.isnan(diameter_m)
    if diameter_m is not None and known.any():
        median, size = float(np.median(distance_m[known])), float(np.median(diameter_m[known]))
        nearest, farthest = _MEDIAN_DIAMETERS
        if median > farthest * size and median <= _SEEN_M[1]:
            across = Reference(
                f"{what} is {shown(median)}",
                median / farthest,
                median / nearest,
                usual_m=(median / USUAL_DIAMETERS[1], median / USUAL_DIAMETERS[0]),
            )
            return _problem("the median diameter in models_info.json", size, across)
        if said := _problem(what, median, distance_reference(size, nearest, farthest), unit):
            return said
    camera = Reference(
        f"cameras see objects {between(*_SEEN_M)} away", *_SEEN_M, usual_m=(0.2, 3.0)
    )
    return _problem(what, median, camera, unit)


def ratio_problem(
    mine: str, distance_m: Float[ndarray, " n"], other: str, other_m: Float[ndarray, " n"]
) -> str:
    """Say how two sources differ in the distances of the same objects in the same images.

    Parameters
    ----------
    mine, other
        The sources, for messages.
    distance_m, other_m
        Distances of the same instances by both, metres.

    Returns
    -------
        The problem, with both medians and the unit that would fit; empty if there is none.
    """
    positive = (distance_m > 0) & (other_m > 0)
    if not positive.any():
        return ""
    ratio = float(np.median(distance_m[positive] / other_m[positive]))
    if 1 / _AGREEING <= ratio <= _AGREEING:
        return ""
    if ratio > 1:
        mine, other, distance_m, other_m, ratio = other, mine, other_m, distance_m, 1 / ratio
    median = float(np.median(other_m[positive]))
    reference = Reference(
        f"in {other} they are {shown(median)} away",
        median / _AGREEING,
        median * _AGREEING,
        usual_m=(median / 1.5, median * 1.5),
    )
    what = f"the median distance of these objects in {mine}"
    return _problem(what, median * ratio, reference)


def outline_problem(
    depth_m: Float[ndarray, " n"],
    box_px: Float[ndarray, " n"],
    diameter_m: Float[ndarray, " n"],
    focal_px: Float[ndarray, " n"],
) -> str:
    """Say how the depths of objects contradict how large they are in the images.

    Parameters
    ----------
    depth_m
        Depths, metres, as read in millimetres.
    box_px
        Longer sides of the objects' bounding boxes, pixels.
    diameter_m, focal_px
        Diameters, and focal lengths of the images.

    Returns
    -------
        The problem, with both numbers and the unit that would fit; empty if there is none.
    """
    if not len(depth_m):
        return ""
    # A silhouette is about as long as the diameter, and at an unfavourable view much shorter.
    implied = focal_px * diameter_m / box_px
    ratio, median = float(np.median(depth_m / implied)), float(np.median(depth_m))
    expected = median / ratio
    reference = Reference(
        f"boxes of {float(np.median(box_px)):.0f} pixels (bbox_obj), a focal length of "
        f"{float(np.median(focal_px)):.0f} pixels and diameters of "
        f"{shown(float(np.median(diameter_m)))} make it at most {shown(expected)}",
        0.25 * expected,
        1.7 * expected,
        usual_m=(0.4 * expected, 1.2 * expected),
    )
    return _problem("the median depth of cam_t_m2c", median, reference)


def models_problem(diameter_m: Float[ndarray, " n"]) -> str:
    """Say how the diameters of all objects contradict what a hand grasps, or nothing."""
    hand = Reference(f"a hand grasps {between(*_GRASPED_M)}", *_GRASPED_M, usual_m=(0.02, 0.5))
    return _problem("the median diameter", float(np.median(diameter_m)), hand)


def diameter_problem(diameter_m: float, size: Float[ndarray, "3"]) -> str:
    """Say how a diameter contradicts the side lengths of the bounding box, or nothing."""
    low, high = float(size.max()) / _LOOSE, float(np.linalg.norm(size)) * _LOOSE
    if diameter_m > high:
        box = Reference(
            f"the diameter is {shown(diameter_m)}",
            diameter_m / np.sqrt(3) / _LOOSE,
            diameter_m * _LOOSE,
        )
        return _problem("the longest of size_x, size_y and size_z", float(size.max()), box)
    box = Reference(
        f"the longest side of the bounding box is {shown(float(size.max()))}", low, high
    )
    return _problem("the diameter", diameter_m, box)


def mesh_problem(
    diameter_m: float, lower: Float[ndarray, "3"], vertices: Float[ndarray, "v 3"]
) -> str:
    """Say how a mesh contradicts the diameter and bounds in models_info.json, or nothing."""
    corner, size = vertices.min(axis=0), np.ptp(vertices, axis=0)
    side, diagonal = float(size.max()), float(np.linalg.norm(size))
    if diameter_m > diagonal * _LOOSE:
        info = Reference(
            f"its diameter in models_info.json is {shown(diameter_m)}",
            diameter_m / np.sqrt(3) / _LOOSE,
            diameter_m * _LOOSE,
        )
        return _problem("the mesh's longest side", side, info)
    mesh = Reference(f"the mesh's longest side is {shown(side)}", side / _LOOSE, diagonal * _LOOSE)
    if said := _problem("the diameter in models_info.json", diameter_m, mesh):
        return said
    axis = int(np.argmax(np.abs(lower - corner)))
    if abs(lower[axis] - corner[axis]) <= (_LOOSE - 1) * diagonal:
        return ""
    return (
        f"min_{'xyz'[axis]} in models_info.json is {shown(float(lower[axis]))}, but the mesh "
        f"begins at {shown(float(corner[axis]))}"
    )


def symmetry_problem(
    rotation: Float[ndarray, "3 3"],
    translation: Float[ndarray, "3"],
    centre: Float[ndarray, "3"],
    diameter_m: float,
) -> str:
    """Say how far a symmetry moves the centre of the bounding box, if that is too far.

    A symmetry leaves the centroid where it is. The centre of the bounding box lies near it: for a
    triangular prism, the least favourable, it moves by a quarter of the diameter.
    """
    most = 0.3 * diameter_m
    moved = {
        unit: float(
            np.linalg.norm(rotation @ centre + translation * factor / METRES["mm"] - centre)
        )
        for unit, factor in METRES.items()
    }
    if moved["mm"] <= most:
        return ""
    fitting = [unit for unit, distance in moved.items() if distance <= most]
    return (
        f"moves the object's centre by {shown(moved['mm'])}, but the object is "
        f"{shown(diameter_m)} across"
        + (f"; is it in {UNIT_NAMES[fitting[0]]}, not in millimetres?" if fitting else "")
    )


def camera_problem(K: Float[ndarray, "3 3"], image_size: tuple[int, int] | None = None) -> str:
    """Say why a matrix cannot be a camera's intrinsics in pixels, or nothing."""
    fx, fy, cx, cy = (float(K[i]) for i in ((0, 0), (1, 1), (0, 2), (1, 2)))
    if np.abs(K[2, :2]).max() > 1e-3 and max(abs(cx), abs(cy)) < 1e-3:
        return "is transposed: the principal point stands in the last row, not in the last column"
    if np.abs(K[2] - [0.0, 0.0, 1.0]).max() > 1e-3 or abs(K[1, 0]) > 1e-3 * abs(fx):
        last = " ".join(f"{x:g}" for x in K[2])
        return f"is no matrix of intrinsics; its last row is {last}, not 0 0 1"
    if min(fx, fy) <= 0:
        return f"has focal lengths {fx:g} and {fy:g}, which should be positive pixels"
    width, height = image_size or (2 * cx, 2 * cy)
    focal = f"has focal lengths {fx:.4g} and {fy:.4g}"
    if max(fx, fy) < 20:
        return f"{focal}, which are not in pixels"
    if not 0.5 <= fx / fy <= 2.0:
        return f"{focal}, which should be about equal"
    if image_size is None:
        return ""
    if not 0.1 * width <= fx <= 50 * width:
        return f"{focal} pixels, but the image is {width} pixels wide; is it of another resolution?"
    if not (-width <= cx <= 2 * width and -height <= cy <= 2 * height):
        return (
            f"has its principal point at {cx:.4g}, {cy:.4g}, far outside the image of "
            f"{width}x{height} pixels; is it of another resolution?"
        )
    return ""
