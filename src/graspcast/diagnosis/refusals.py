"""Refusals of the readers as findings: what a message says, by a name that does not change."""

from __future__ import annotations

import re
from collections.abc import Sequence
from os import PathLike

from graspcast.diagnosis.finding import Finding
from graspcast.errors import FormatError, GraspcastError

__all__ = ["code_of", "refusal"]

_UNITS = re.compile(
    r"is it in (millimetres|centimetres|metres|inches)|make it at most|are not in pixels"
)

_NAMES: Sequence[tuple[str, str, str]] = (
    (
        r"median diameter in models_info\.json is|the median diameter is|the diameter is",
        "models-unit",
        "Convert models_info.json to millimetres",
    ),
    (
        r"symmetries_.*moves the object's centre",
        "symmetry-unit",
        "Write the symmetry's translation in millimetres",
    ),
    (
        r"the diameter in models_info\.json is|size_x, size_y and size_z",
        "models-unit",
        "Convert models_info.json to millimetres",
    ),
    (r"mesh's longest side is", "mesh-unit", "Convert the mesh to millimetres"),
    (
        r"min_[xyz] in models_info\.json",
        "mesh-frame",
        "Take the mesh and models_info.json from one release; their origins differ",
    ),
    (
        r"are shares of the image|shares of the image\?",
        "boxes-shares",
        "Multiply the boxes by the image size",
    ),
    (r"two corners", "boxes-corners", "Write x, y, width, height: subtract the first corner"),
    (r"transposed rotations|rotations transposed", "poses-transposed", "Transpose the rotations"),
    (r"are they obj_T_cam", "poses-inverted", "Invert the poses: BOP's map object to camera"),
    (r"are quaternions", "quaternion-order", "Convert the quaternions again, in the other order"),
    (
        r"OpenGL's camera frame|PyTorch3D's camera frame",
        "camera-axes",
        "Turn the poses into OpenCV's camera frame: x right, y down, z forward",
    ),
    (r"radians read as degrees", "rotation-unit", "Convert the angles again, without degrees"),
    (r"mirrored rotation", "poses-mirrored", "Write proper rotations (determinant 1)"),
    (r"behind the camera", "poses-behind", "Write poses in OpenCV's camera frame"),
    (
        r"rotation scaled by|no rotation matrix|away from the nearest",
        "no-rotation",
        "Write rotation matrices, with all their digits",
    ),
    (r"same pose as|same poses as", "estimator-copied", "Leave one of the two files out"),
    (r"is transposed: the principal point", "camera-transposed", "Write cam_K row by row"),
    (
        r"focal lengths?|principal point|no matrix of intrinsics",
        "camera-wrong",
        "Write the intrinsics of the images, in pixels",
    ),
    (r"rows share their trial", "outcomes-repeated", "Leave one row of each trial"),
    (r"repeats the instance and pose|repeats the object", "rows-repeated", "Leave one of the rows"),
    (
        r"estimates of another dataset|dataset or split|by its name a CSV|of an instance that",
        "other-dataset",
        "Give the directory of the dataset that the file is of",
    ),
    (r"is not in .*models_info|are not in .*models_info", "other-dataset", "Give its own models"),
    (r"another reading|read in the other direction", "camera-poses-inverted", "Invert the poses"),
    (r"cameras that look along -z", "camera-poses-axes", "Turn them into OpenCV's frame"),
    (r"instead of (milli|centi)?(metres|inches)", "camera-poses-unit", "Write the unit they have"),
    (r"each rotation transposed", "camera-poses-transposed", "Transpose the rotations"),
    (r"camera poses contradict", "camera-poses-wrong", "Leave the camera poses of such scenes out"),
    (
        r"no image of the estimates has a camera pose",
        "camera-poses-unmatched",
        "Number the images alike",
    ),
    (r"has the same scene and image as", "duplicate-images", "Remove one of the two files"),
)

_CURES = {
    "results-unit": "Convert the translations of the results to millimetres",
    "truth-unit": "Convert cam_t_m2c to millimetres",
}


def code_of(error: GraspcastError, kind: str) -> tuple[str, str]:
    """Return the name of what a reader refuses, and the cure.

    Parameters
    ----------
    error
        The refusal.
    kind
        What was read: ``results``, ``truth``, ``models``, ``boxes``, ``outcomes``,
        ``camera-poses``, ``images``.
    """
    text = str(error)
    for pattern, code, cure in _NAMES:
        if re.search(pattern, text):
            return code, cure
    if _UNITS.search(text):
        code = f"{kind}-unit"
        return code, _CURES.get(code, "Convert the lengths to millimetres")
    return f"{kind}-unreadable", "Mend the file as the message says"


def refusal(error: GraspcastError, kind: str, path: str | PathLike[str]) -> Finding:
    """Return a reader's refusal as a finding of severity ``error``.

    Parameters
    ----------
    error, kind
        As for :func:`code_of`.
    path
        The file, unless the error names one.
    """
    code, cure = code_of(error, kind)
    if isinstance(error, FormatError):
        where = f"{error.where}: " if error.where else ""
        return Finding("error", code, str(error.path), f"{where}{error.problem}", cure)
    text = str(error).removeprefix(f"{path}: ")
    return Finding("error", code, str(path), text, cure)
