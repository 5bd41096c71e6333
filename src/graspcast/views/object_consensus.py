"""Consensus of objects: the camera's motion between two images, from poses of objects in both.

Each object that stands still states the motion. Objects that were moved, and gross errors, state
another one; they are found by their disagreement with the rest. A symmetric object states several
motions, of which the one that fits the others is meant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.pose.transforms import (
    invert,
    rotation_from_vector,
    rotation_vector,
    skew,
    transform,
)

__all__ = ["ObjectPoses", "Statements", "agreement", "fit_motion", "medoid", "statements"]

_ITERATIONS, _CONVERGED = 10, 1e-6
_DIMENSIONS = 6.0


@dataclass(frozen=True, eq=False)
class ObjectPoses:
    """Poses of o objects in images, with their uncertainty, whose leading shape is ``...``.

    Attributes
    ----------
    cam_T_obj
        Metres, the identity where there is none, (..., o, 4, 4).
    present
        Where there is one, (..., o).
    covariance
        Of the positions, in the camera's axes, m², (..., o, 3, 3).
    rotation_variance
        Of the rotations per axis, rad², (..., o).
    """

    cam_T_obj: Float[ndarray, "*i o 4 4"]
    present: Bool[ndarray, "*i o"]
    covariance: Float[ndarray, "*i o 3 3"]
    rotation_variance: Float[ndarray, "*i o"]

    def at(self, place: int | ndarray) -> ObjectPoses:
        """Return the poses of some images."""
        return ObjectPoses(
            self.cam_T_obj[place],
            self.present[place],
            self.covariance[place],
            self.rotation_variance[place],
        )


@dataclass(frozen=True, eq=False)
class Statements:
    """The motions that objects state for m pairs of images, one for each symmetry of an object.

    Attributes
    ----------
    cam_T_view
        (m, h, 4, 4).
    owner
        The object's place, (h,).
    symmetry
        The symmetry, (h, 4, 4).
    present
        Where the object is in both images, (m, h).
    """

    cam_T_view: Float[ndarray, "m h 4 4"]
    owner: Int[ndarray, " h"]
    symmetry: Float[ndarray, "h 4 4"]
    present: Bool[ndarray, "m h"]


def statements(
    cam: ObjectPoses, views: ObjectPoses, objects: list[tuple[int, Float[ndarray, "_ 4 4"]]]
) -> Statements:
    """Return the motions that some objects state.

    Parameters
    ----------
    cam, views
        Poses in the judged image, (o,), and in m other images, (m, o).
    objects
        Place and symmetries of each object that is asked.
    """
    owner = np.array([o for o, s in objects for _ in s], dtype=np.int64)
    symmetry = np.concatenate([np.zeros((0, 4, 4)), *(s for _, s in objects)])
    poses = cam.cam_T_obj[owner] @ symmetry @ invert(views.cam_T_obj[:, owner])
    return Statements(poses, owner, symmetry, cam.present[owner] & views.present[:, owner])


def medoid(
    stated: Statements,
    allowed: Bool[ndarray, "m h"],
    at: Float[ndarray, "m 3"],
    scale: tuple[float, float],
) -> tuple[Int[ndarray, " m"], Int[ndarray, "m h"]]:
    """Return the statement that is nearest to those of all objects, and how many agree with each.

    Parameters
    ----------
    stated
        Of h statements for each of m pairs.
    allowed
        Those that count.
    at
        The point, in the view's frame, at which positions are compared, metres.
    scale
        The distance (m) and the angle (rad) within which two statements agree.
    """
    poses = stated.cam_T_view
    moved = np.einsum("mhij,mj->mhi", poses[..., :3, :3], at) + poses[..., :3, 3]
    apart = np.linalg.norm(moved[:, :, None] - moved[:, None], axis=-1)
    flat = poses[..., :3, :3].reshape(*poses.shape[:2], 9)
    turned = np.arccos(np.clip((flat @ np.swapaxes(flat, 1, 2) - 1) / 2, -1, 1))
    cost = np.log1p(3 * (apart / scale[0] + turned / scale[1]))
    agrees = (apart <= scale[0]) & (turned <= scale[1]) & allowed[:, None]
    cost = np.where(allowed[:, None], cost, np.log1p(1e3))
    if len(stated.owner):
        first = np.flatnonzero(np.diff(stated.owner, prepend=-1))
        cost = np.minimum.reduceat(cost, first, axis=2)
        agrees = np.logical_or.reduceat(agrees, first, axis=2)
    total = np.where(allowed, cost.sum(axis=2), np.inf)
    count = np.where(allowed, agrees.sum(axis=2), 0)
    if not total.shape[1]:
        return np.zeros(len(total), dtype=np.int64), count
    return total.argmin(axis=1), count


def fit_motion(
    start: Float[ndarray, "m 4 4"],
    cam: ObjectPoses,
    views: ObjectPoses,
    allowed: Bool[ndarray, "m o"],
    symmetries: list[Float[ndarray, "_ 4 4"]],
) -> tuple[Float[ndarray, "m 4 4"], Float[ndarray, "m 6 6"], Float[ndarray, "m o"]]:
    """Fit the motion to the poses of objects in both images, with Cauchy weights.

    Parameters
    ----------
    start
        The first guess.
    cam, views
        Poses in the judged image, (o,), and in m other images, (m, o).
    allowed
        The objects that count, at least one for each pair.
    symmetries
        Of each object.

    Returns
    -------
    ``cam_T_view``; its covariance (position, rotation vector) in the judged camera's axes, about
    its origin; and the squared Mahalanobis distance of each object, of six degrees of freedom.
    """
    R, t = start[:, :3, :3].copy(), start[:, :3, 3].copy()
    target = _equivalent(start, cam, views, symmetries)
    for _ in range(_ITERATIONS):
        step, information, _, _ = _step(R, t, target, cam, views, allowed)
        change = np.linalg.solve(information, step[..., None])[..., 0]
        turn = rotation_from_vector(change[:, 3:])
        R, t = turn @ R, np.einsum("mij,mj->mi", turn, t) + change[:, :3]
        if not len(change) or np.abs(change).max() < _CONVERGED:
            break
    _, information, square, distance = _step(R, t, target, cam, views, allowed)
    inverse = np.linalg.inv(information)
    return transform(R, t), inverse @ square @ inverse, distance


def _equivalent(
    start: ndarray, cam: ObjectPoses, views: ObjectPoses, symmetries: list[ndarray]
) -> Float[ndarray, "m o 3 3"]:
    """Return the judged image's rotations, turned to the equivalents that fit the first guess."""
    carried = start[:, None, :3, :3] @ views.cam_T_obj[..., :3, :3]
    out = np.broadcast_to(cam.cam_T_obj[..., :3, :3], carried.shape).copy()
    for o, symmetry in enumerate(symmetries):
        if len(symmetry) > 1:
            turned = cam.cam_T_obj[o, :3, :3] @ symmetry[:, :3, :3]
            trace = carried[:, o].reshape(-1, 9) @ turned.reshape(-1, 9).T
            out[:, o] = turned[trace.argmax(axis=1)]
    return out


def _step(
    R: ndarray,
    t: ndarray,
    target: ndarray,
    cam: ObjectPoses,
    views: ObjectPoses,
    allowed: ndarray,
) -> tuple[ndarray, ndarray, ndarray, ndarray]:
    """Return gradient, information, the covariance of the gradient, and distances."""
    own = R[:, None]
    p = (own @ views.cam_T_obj[..., :3, 3:])[..., 0] + t[:, None]
    error = cam.cam_T_obj[..., :3, 3] - p
    turn = rotation_vector(target @ np.swapaxes(own @ views.cam_T_obj[..., :3, :3], -1, -2))
    W = np.linalg.inv(cam.covariance + own @ views.covariance @ np.swapaxes(own, -1, -2))
    rotation = cam.rotation_variance + views.rotation_variance
    pull = (W @ error[..., None])[..., 0]
    distance = (error * pull).sum(axis=-1) + (turn**2).sum(axis=-1) / rotation
    weight = allowed / (1 + distance / _DIMENSIONS)
    K = skew(p)
    gradient = np.concatenate([pull, np.cross(p, pull) + turn / rotation[..., None]], axis=-1)
    J = np.concatenate([np.broadcast_to(np.eye(3), K.shape), -K], axis=-1)
    each = np.swapaxes(J, -1, -2) @ W @ J
    each[..., 3:, 3:] += np.eye(3) / rotation[..., None, None]
    w = weight[..., None, None]
    step = (weight[..., None] * gradient).sum(axis=1)
    return step, (w * each).sum(axis=1), (w**2 * each).sum(axis=1), distance


def agreement(
    stated: Statements,
    cam_T_obj: Float[ndarray, "4 4"],
    view_T_obj: Float[ndarray, "m 4 4"],
    symmetries: Float[ndarray, "s 4 4"],
) -> tuple[Float[ndarray, "m h"], Float[ndarray, "m h"]]:
    """Return how far each stated motion carries an object from where it is: metres, radians."""
    carried = stated.cam_T_view @ view_T_obj[:, None]
    apart = np.linalg.norm(carried[..., :3, 3] - cam_T_obj[:3, 3], axis=-1)
    turned = (cam_T_obj[:3, :3] @ symmetries[:, :3, :3]).reshape(-1, 9)
    trace = (carried[..., :3, :3].reshape(*apart.shape, 9) @ turned.T).max(axis=-1, initial=-1.0)
    return apart, np.asarray(np.arccos(np.clip((trace - 1) / 2, -1, 1)))
