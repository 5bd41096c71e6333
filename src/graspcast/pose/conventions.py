"""Conventions of poses: which single change makes one estimator's poses agree with others.

Inverted transforms, transposed rotations, quaternions in another order and other camera axes are
sane poses, often, but of nothing. They are found by comparison: poses that hardly ever agree with
others as they are, and mostly do after one such change, are named as that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.pose.transforms import (
    invert,
    quaternion,
    rotation_from_quaternion,
    rotation_from_vector,
    rotation_vector,
)

__all__ = [
    "CONVENTIONS",
    "MIN_INSTANCES",
    "Convention",
    "Found",
    "behind_hint",
    "find_convention",
    "find_odd_one",
]

MIN_INSTANCES = 5
"""So many instances have to agree after a change, however few there are."""

_SAME_ANGLE = np.radians(20.0)
_SAME_DISTANCE = 0.1
"""Two poses agree if their origins are no further apart than this share of their distance."""

_SELDOM, _MOSTLY = 0.2, 0.5
"""Shares of instances that agree: at most before the change, at least after it.

Of the published estimates (EPOS, GDRNPP and ZebraPose on LM-O and YCB-V) no two estimators, and no
estimator and the ground truth, are accused, together or for a single object or scene.
"""


_VARIETY = 0.1
"""Least third singular value of the quaternions that agree, of 0.5 for all rotations alike.

Where a box looks the same after a half turn, a wrong order of its quaternion can be just that turn,
in a family of views: an object that is filmed from one side proves nothing.
"""


@dataclass(frozen=True)
class Convention:
    """A convention that differs from ``cam_T_obj`` in OpenCV's camera frame.

    Attributes
    ----------
    change
        How the poses are changed into ours: they agree "when …".
    question
        What they may be: "are they …".
    undo
        The change: poses (n, 4, 4) to poses.
    """

    change: str
    question: str
    undo: Callable[[ndarray], ndarray]


@dataclass(frozen=True)
class Found:
    """A convention in which poses agree with others.

    Attributes
    ----------
    convention
        What was changed.
    agreeing, compared
        How many poses agree after the change, of how many.
    before
        How many agree unchanged.
    """

    convention: Convention
    agreeing: int
    compared: int
    before: int

    def text(self, mine: str, theirs: str) -> str:
        """Say it in words, with words for either's poses."""
        return (
            f"{self.agreeing} of {self.compared} {mine} agree with {theirs} when "
            f"{self.convention.change} ({self.before} do as they are): {self.convention.question}"
        )


def _with_rotation(poses: Float[ndarray, "n 4 4"], R: Float[ndarray, "n 3 3"]) -> ndarray:
    out = poses.copy()
    out[:, :3, :3] = R
    return out


def _reordered(order: Sequence[int]) -> Callable[[ndarray], ndarray]:
    """Return the change that puts the quaternion's components, read as wxyz, into an order."""

    def undo(poses: ndarray) -> ndarray:
        q = quaternion(poses[:, :3, :3])[:, list(order)]
        return _with_rotation(poses, rotation_from_quaternion(q))

    return undo


def _in_radians(poses: ndarray) -> ndarray:
    vector = np.degrees(rotation_vector(poses[:, :3, :3]))
    return _with_rotation(poses, rotation_from_vector(vector))


def _camera_axes(*signs: float) -> Callable[[ndarray], ndarray]:
    return lambda poses: np.diag([*signs, 1.0]) @ poses


CONVENTIONS = (
    Convention("inverted", "are they obj_T_cam instead of cam_T_obj?", invert),
    Convention(
        "their rotations are transposed",
        "are the rotations transposed (written column by column, or obj_R_cam)?",
        lambda poses: _with_rotation(poses, np.swapaxes(poses[:, :3, :3], 1, 2)),
    ),
    Convention(
        "their quaternions are read in the order wxyz",
        "are quaternions wxyz read as xyzw?",
        _reordered((1, 2, 3, 0)),
    ),
    Convention(
        "their quaternions are read in the order xyzw",
        "are quaternions xyzw read as wxyz?",
        _reordered((3, 0, 1, 2)),
    ),
    Convention(
        "the camera's y and z axes are flipped",
        "are they in OpenGL's camera frame (y up, z backwards)?",
        _camera_axes(1.0, -1.0, -1.0),
    ),
    Convention(
        "the camera's x and y axes are flipped",
        "are they in PyTorch3D's camera frame (x left, y up)?",
        _camera_axes(-1.0, -1.0, 1.0),
    ),
    Convention(
        "their rotation angles are multiplied by 180/pi",
        "are rotations in radians read as degrees?",
        _in_radians,
    ),
)
"""The conventions that are looked for."""


def find_convention(
    cam_T_est: Float[ndarray, "n 4 4"],
    cam_T_ref: Float[ndarray, "n 4 4"],
    symmetries: Sequence[ndarray] | None = None,
) -> Found | None:
    """Find the change after which most poses agree with others that hardly ever do as they are.

    Parameters
    ----------
    cam_T_est
        Poses in a convention to be found, (n, 4, 4).
    cam_T_ref
        Poses of the same instances by another estimator, or true ones; NaN where unknown.
    symmetries
        The symmetries of each instance's object, (s, 4, 4) each, the identity among them.

    Returns
    -------
        What was found; None if the poses agree as they are, agree after no change, or are fewer
        than :data:`MIN_INSTANCES`.
    """
    known = np.isfinite(cam_T_est).all(axis=(1, 2)) & np.isfinite(cam_T_ref).all(axis=(1, 2))
    if int(known.sum()) < MIN_INSTANCES:
        return None
    est, ref = cam_T_est[known], cam_T_ref[known]
    of_each = None
    if symmetries is not None:
        of_each = [symmetries[i] for i in np.flatnonzero(known).tolist()]
    before = int(_agree(est, ref, of_each).sum())
    if before > _SELDOM * len(est):
        return None
    agreeing = [_agree(c.undo(est), ref, of_each) for c in CONVENTIONS]
    best = int(np.argmax([a.sum() for a in agreeing]))
    count, convention = int(agreeing[best].sum()), CONVENTIONS[best]
    if count < max(MIN_INSTANCES, _MOSTLY * len(est)):
        return None
    # Where positions change too, they are evidence enough.
    moved = not np.array_equal(convention.undo(est)[:, :3, 3], est[:, :3, 3])
    if not moved and _variety(ref[agreeing[best]]) < _VARIETY:
        return None
    return Found(convention, count, len(est), before)


def _variety(poses: Float[ndarray, "n 4 4"]) -> float:
    q = quaternion(poses[:, :3, :3])
    return float(np.linalg.svd(q, compute_uv=False)[2] / np.sqrt(len(q)))


def _agree(
    cam_T_a: Float[ndarray, "n 4 4"],
    cam_T_b: Float[ndarray, "n 4 4"],
    symmetries: Sequence[ndarray] | None,
) -> Bool[ndarray, " n"]:
    """Find which poses are about the same, up to the object's symmetries."""
    a, b = cam_T_a[:, :3, 3], cam_T_b[:, :3, 3]
    near: ndarray = np.linalg.norm(a - b, axis=1) <= _SAME_DISTANCE * np.linalg.norm(b, axis=1)
    turn = np.swapaxes(cam_T_b[:, :3, :3], 1, 2) @ cam_T_a[:, :3, :3]
    cosine = np.trace(turn, axis1=1, axis2=2)
    if symmetries is not None:
        groups: dict[int, list[int]] = {}
        for i, mine in enumerate(symmetries):
            if len(mine) > 1 and near[i]:
                groups.setdefault(id(mine), []).append(i)
        for rows in groups.values():
            R = symmetries[rows[0]][:, :3, :3]
            cosine[rows] = np.einsum("nij,sji->ns", turn[rows], R).max(axis=1)
    return near & ((cosine - 1.0) / 2.0 >= np.cos(_SAME_ANGLE))


def find_odd_one(
    names: Sequence[str],
    cam_T_obj: Float[ndarray, "k n 4 4"],
    symmetries: Sequence[ndarray] | None = None,
) -> str:
    """Name the estimator whose poses agree with another's only in another convention.

    Parameters
    ----------
    names
        The K estimators.
    cam_T_obj
        Their poses of n instances, (K, n, 4, 4).
    symmetries
        As for :func:`find_convention`.

    Returns
    -------
        The text, empty if there is none. Of only two estimators either may be the odd one.
    """
    pairs = [
        (i, j)
        for i in range(len(names))
        for j in range(i)
        if find_convention(cam_T_obj[i], cam_T_obj[j], symmetries)
    ]
    if not pairs:
        return ""
    times = [sum(k in pair for pair in pairs) for k in range(len(names))]
    most = max(times)
    # The last of equals: the first is the principal, nearly always.
    odd = max(k for k in range(len(names)) if times[k] == most)
    other = next(i if j == odd else j for i, j in pairs if odd in (i, j))
    found = find_convention(cam_T_obj[odd], cam_T_obj[other], symmetries)
    if found is None:
        return ""
    doubt = "" if most > 1 else f" Or those by {names[other]} are."
    return found.text(f"estimates by {names[odd]}", f"those by {names[other]}") + doubt


def behind_hint(behind: int, total: int) -> str:
    """Say what it may mean that many of an estimator's poses lie behind the camera, or nothing.

    Parameters
    ----------
    behind, total
        How many poses there are, and how many of them have z below 0.
    """
    if total < MIN_INSTANCES or behind < 0.2 * total:
        return ""
    question = CONVENTIONS[4 if behind > 0.95 * total else 0].question
    return f"; {behind} of {total} poses lie behind it: {question}"
