"""The constant transform between two sources' poses of an object, and how much it explains.

Estimates err most along the viewing ray, and some are far off. So offsets along the ray count less,
rotations and offsets are robust means (reweighted least squares), and they start from the instance
that most others agree with. Of the object's symmetries that one is taken for each instance with
which it agrees best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.pose.transforms import (
    invert,
    project_to_rotation,
    rotation_angle,
    transform,
)

__all__ = ["Offset", "find_offset", "refit_shift"]

_ROUNDS = 20
_ALONG = 0.25
"""Weight of offsets along the viewing ray."""
_NEAR_RAD = np.radians(12.0)
_LEAST_SPREAD_M, _LEAST_SPREAD_RAD = 5e-4, np.radians(0.2)


@dataclass(frozen=True, eq=False)
class Offset:
    """A constant transform between two sources' poses.

    Attributes
    ----------
    one_T_other
        The transform, metres, (4, 4).
    before, after
        Median distance of the poses as they are and with the transform, in diameters: offset
        (along the ray a quarter of it) and half the turn in radians.
    agreeing
        Share of the instances that the transform explains.
    instances
        How many there are.
    error_m, error_rad
        Standard errors of the transform's offset, the largest of three axes, and its turn.
    """

    one_T_other: Float[ndarray, "4 4"]
    before: float
    after: float
    agreeing: float
    instances: int
    error_m: float
    error_rad: float

    @property
    def shift_m(self) -> float:
        """Length of the offset, metres."""
        return float(np.linalg.norm(self.one_T_other[:3, 3]))

    @property
    def turn_rad(self) -> float:
        """Angle of the rotation, radians."""
        return float(rotation_angle(self.one_T_other[:3, :3]))


def find_offset(
    poses: Float[ndarray, "n 4 4"],
    others: Float[ndarray, "n 4 4"],
    symmetries: Float[ndarray, "s 4 4"],
    diameter_m: float,
) -> Offset:
    """Estimate the constant transform between two sources' poses of one object.

    Parameters
    ----------
    poses, others
        ``cam_T_one`` and ``cam_T_other`` of the same instances, metres.
    symmetries
        The object's symmetries in the frame of ``other``, the identity among them.
    diameter_m
        The object's diameter.
    """
    given = invert(poses) @ others
    choices = given[:, None] @ symmetries
    rotation = _mode(choices)
    chosen = given
    for _ in range(4):
        chosen = _nearest(choices, rotation)
        rotation = _robust_mean(chosen[:, :3, :3], rotation)
    others_now = poses @ chosen
    turned = rotation_angle(rotation.T @ chosen[:, :3, :3])
    inside = turned < max(3 * float(np.median(turned)), np.radians(5.0))
    shift, error_m = _shift(poses, others_now, inside)
    total = transform(rotation, shift)
    distances = _distances(poses @ total, others_now, diameter_m)
    now = _distances(poses, poses @ _nearest(choices, np.eye(3)), diameter_m)
    near = turned[inside]
    error_rad = 1.25 * float(np.median(near)) / np.sqrt(max(len(near), 1))
    return Offset(
        total,
        float(np.median(now)),
        float(np.median(distances)),
        float((distances < max(2.5 * float(np.median(distances)), 0.05)).mean()),
        len(poses),
        error_m,
        error_rad,
    )


def _nearest(choices: Float[ndarray, "n s 4 4"], rotation: Float[ndarray, "3 3"]) -> ndarray:
    """Return of each instance the symmetric equivalent with the rotation nearest to a given one."""
    trace = np.einsum("nsij,ij->ns", choices[:, :, :3, :3], rotation)
    best: ndarray = choices[np.arange(len(choices)), trace.argmax(axis=1)]
    return best


def _mode(choices: Float[ndarray, "n s 4 4"]) -> Float[ndarray, "3 3"]:
    """Return the rotation of the instance that most others are near to."""
    few = choices[:: max(1, len(choices) // 150)]
    candidates = few[:, 0, :3, :3]
    cosine = np.einsum("aij,nsij->ans", candidates, few[:, :, :3, :3]).max(axis=2)
    angle = np.arccos(np.clip((cosine - 1) / 2, -1, 1))
    return candidates[int((angle < _NEAR_RAD).sum(axis=1).argmax())]


def _robust_mean(rotations: Float[ndarray, "n 3 3"], start: Float[ndarray, "3 3"]) -> ndarray:
    """Return the rotation with the smallest sum of angles, those far away counting less."""
    mean = start
    for _ in range(_ROUNDS):
        angle = rotation_angle(mean.T @ rotations)
        scale = max(1.5 * float(np.median(angle)), _LEAST_SPREAD_RAD)
        weight = 1 / (1 + (angle / scale) ** 2) ** 2
        mean = project_to_rotation(np.einsum("n,nij->ij", weight, rotations))
    return mean


def _shift(
    poses: Float[ndarray, "n 4 4"], others: Float[ndarray, "n 4 4"], inside: Bool[ndarray, " n"]
) -> tuple[Float[ndarray, "3"], float]:
    """Return the offset in the object's frame, and the standard error of its worst axis, metres.

    Each instance says ``R shift = offset``, in a frame along its viewing ray.
    """
    R, offset = poses[:, :3, :3], others[:, :3, 3] - poses[:, :3, 3]
    ray = poses[:, :3, 3] / np.linalg.norm(poses[:, :3, 3], axis=1)[:, None]
    side = np.cross(ray, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side, axis=1)[:, None]
    axes = np.stack([side, np.cross(ray, side), _ALONG * ray], axis=1)
    A, b = axes @ R, np.einsum("nij,nj->ni", axes, offset)
    weight = inside.astype(np.float64)
    shift, scale = np.zeros(3), 1.0
    for _ in range(_ROUNDS):
        normal = np.einsum("n,nij,nik->jk", weight, A, A) + 1e-12 * np.eye(3)
        shift = np.linalg.solve(normal, np.einsum("n,nij,ni->j", weight, A, b))
        residual = np.linalg.norm(A @ shift - b, axis=1)
        scale = max(1.5 * float(np.median(residual[inside])), _LEAST_SPREAD_M)
        weight = inside / (1 + (residual / scale) ** 2) ** 2
    normal = np.einsum("n,nij,nik->jk", weight, A, A) + 1e-12 * np.eye(3)
    variance = np.linalg.inv(normal) * scale**2 / 3
    return shift, float(np.sqrt(np.linalg.eigvalsh(variance)[-1]))


def _distances(
    poses: Float[ndarray, "n 4 4"], others: Float[ndarray, "n 4 4"], diameter_m: float
) -> Float[ndarray, " n"]:
    offset = others[:, :3, 3] - poses[:, :3, 3]
    ray = others[:, :3, 3] / np.linalg.norm(others[:, :3, 3], axis=1)[:, None]
    along = (offset * ray).sum(axis=1)
    across = np.linalg.norm(offset - along[:, None] * ray, axis=1)
    turn = rotation_angle(np.swapaxes(poses[:, :3, :3], 1, 2) @ others[:, :3, :3])
    return np.asarray(np.hypot(np.hypot(across, along * _ALONG) / diameter_m, turn / 2))


def refit_shift(
    poses: Float[ndarray, "n 4 4"],
    others: Float[ndarray, "n 4 4"],
    symmetries: Float[ndarray, "s 4 4"],
    rotation: Float[ndarray, "3 3"],
) -> Float[ndarray, "3"]:
    """Return the offset of the constant transform whose rotation is known, metres.

    Parameters
    ----------
    poses, others, symmetries
        As for :func:`find_offset`.
    rotation
        The rotation.
    """
    chosen = _nearest((invert(poses) @ others)[:, None] @ symmetries, rotation)
    turned = rotation_angle(rotation.T @ chosen[:, :3, :3])
    inside = turned < max(3 * float(np.median(turned)), np.radians(5.0))
    return _shift(poses, poses @ chosen, inside)[0]
