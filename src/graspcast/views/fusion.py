"""Fusion: one pose and its covariance from K estimators' poses in V views of a static scene.

Each estimate is known well across its own viewing ray and badly along it, so views from different
sides complete each other. All estimates are carried into the judged image's camera frame and
averaged by iteratively reweighted least squares with Cauchy weights. The errors have a part of each
estimator's own and a part that all estimators of one image share, which further estimators do not
reduce; the noise of the camera motion belongs to the second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.pose.metrics import nearest_symmetric
from graspcast.pose.transforms import (
    compose,
    invert,
    rotation_from_vector,
    rotation_vector,
    transform,
)
from graspcast.views.camera_motion import CameraNoise, noise_of_views
from graspcast.views.motion import carried_covariance

__all__ = ["CONTRADICTION", "FusedPoses", "fuse_poses"]

_DIMENSIONS = 6.0
CONTRADICTION = 60.0
"""Squared Mahalanobis distance (6 degrees of freedom) from which an estimate contradicts the rest.

Estimates of published estimators scatter up to some three standard deviations of the default
spreads; ten per degree of freedom lie beyond what their tails reach in most images.
"""
_ITERATIONS = 10
_CONVERGED = 1e-9
_LEAST_OWN = 1e-4
_MEDOID_SCALE = (0.01, 0.07)


@dataclass(frozen=True, eq=False)
class FusedPoses:
    """Fused poses of n instances.

    Attributes
    ----------
    cam_T_obj
        In the judged image's camera frame, metres, (n, 4, 4).
    covariance
        Of position (3, m) and rotation vector (3, rad) in the camera's axes, about the object's
        origin, (n, 6, 6).
    used
        Which estimates entered, by view and estimator, (n, V, K).
    dropped
        Which were given, but contradict the others, (n, V, K).
    parallax_rad
        The largest angle between the viewing rays that entered, (n,).
    cam_T_est
        Each estimate in the judged image's camera frame, of equivalent ones by symmetry the one
        nearest to the others, (n, V, K, 4, 4).
    """

    cam_T_obj: Float[ndarray, "n 4 4"]
    covariance: Float[ndarray, "n 6 6"]
    used: Bool[ndarray, "n v k"]
    dropped: Bool[ndarray, "n v k"]
    parallax_rad: Float[ndarray, " n"]
    cam_T_est: Float[ndarray, "n v k 4 4"]

    @property
    def covariance_obj(self) -> Float[ndarray, "n 6 6"]:
        """The covariance in the object's axes, (n, 6, 6)."""
        turn = np.zeros((len(self.cam_T_obj), 6, 6))
        turn[:, :3, :3] = turn[:, 3:, 3:] = self.cam_T_obj[:, :3, :3]
        return np.swapaxes(turn, 1, 2) @ self.covariance @ turn

    @property
    def along_m(self) -> Float[ndarray, " n"]:
        """Standard deviation of the position along the judged camera's ray, metres, (n,)."""
        t = self.cam_T_obj[:, :3, 3]
        ray = t / np.linalg.norm(t, axis=1, keepdims=True)
        return np.sqrt(np.einsum("ni,nij,nj->n", ray, self.covariance[:, :3, :3], ray))

    @property
    def across_m(self) -> Float[ndarray, " n"]:
        """Standard deviation of the position across that ray, per axis, metres, (n,)."""
        total = np.trace(self.covariance[:, :3, :3], axis1=1, axis2=2)
        return np.sqrt(np.maximum(total - self.along_m**2, 0.0) / 2)

    @property
    def rotation_rad(self) -> Float[ndarray, " n"]:
        """Standard deviation of the rotation per axis, radians, (n,)."""
        return np.sqrt(np.trace(self.covariance[:, 3:, 3:], axis1=1, axis2=2) / 3)


@dataclass(frozen=True, eq=False)
class _Entries:
    """Estimates in the judged camera's frame, with the variances of their own and shared parts."""

    pose: ndarray  # (n, V, K, 4, 4)
    ray: ndarray  # (n, V, K, 3)
    present: ndarray  # (n, V, K)
    own: ndarray  # (n, V, K, 3): variances across, along, of the rotation
    shared: ndarray  # (n, V, 3)
    view_ray: ndarray  # (n, V, 3)
    moved: ndarray | None = None  # (n, V, 3, 3): of the position, by the motion

    def select(self, rows: ndarray, present: ndarray) -> _Entries:
        parts = (self.pose, self.ray, self.own, self.shared, self.view_ray)
        pose, ray, own, shared, view_ray = (part[rows] for part in parts)
        moved = None if self.moved is None else self.moved[rows]
        return _Entries(pose, ray, present[rows], own, shared, view_ray, moved)


def fuse_poses(
    view_T_obj: Float[ndarray, "n v k 4 4"],
    cam_T_view: Float[ndarray, "n v 4 4"],
    present: Bool[ndarray, "n v k"],
    spread: Float[ndarray, "n k 4"],
    *,
    noise: CameraNoise | Float[ndarray, "n v 2"] | None = None,
    motion_covariance: Float[ndarray, "n v 6 6"] | None = None,
    symmetries: Sequence[Float[ndarray, "_ 4 4"]] | None = None,
    principal: int = 0,
    own_image_stays: bool = False,
) -> FusedPoses:
    """Fuse the poses of n instances by K estimators in V views.

    Views whose estimates all contradict the others are dropped, and so is a single estimate that
    does. Where no two views agree, those of the judged image alone remain, or those of these that
    agree with what is fused of them; where no two estimates of all agree, the principal's.

    Parameters
    ----------
    view_T_obj
        Each estimator's pose in each view's camera frame, metres; view 0 is the judged image.
    cam_T_view
        Each view's camera in the judged camera's frame; the identity for view 0.
    present
        Which estimates there are; the judged image has at least one for every instance.
    spread
        Across, along, rotation and shared of :class:`~graspcast.views.spread.Spread`.
    noise
        Of the camera motion from the judged image to each other view; or for each view its
        standard deviations of translation (m) and rotation (rad), of which view 0's is not used.
    motion_covariance
        Further uncertainty of the motion to each view: of position (m) and rotation vector (rad),
        in the judged camera's axes, about its centre.
    symmetries
        Of each instance's object, the identity first.
    principal
        The estimator that remains where no two estimates agree.
    own_image_stays
        Views that contradict the judged image never outvote it: it is not sure that the object
        stood still.

    Raises
    ------
    InputError
        If shapes differ, a number is not finite, noise is negative, or an instance has no estimate
        in the judged image.
    """
    _check(view_T_obj, cam_T_view, present, spread)
    sizes = noise_of_views(noise, len(present), present.shape[1])
    if not len(present):
        none, parallax = np.zeros((0, 6, 6)), np.zeros(0)
        return FusedPoses(view_T_obj[:, 0, 0], none, present, present, parallax, view_T_obj)
    entries = _entries(view_T_obj, cam_T_view, present, spread, sizes)
    if motion_covariance is not None and motion_covariance.any():
        entries = _moved(entries, motion_covariance)
    entries = _turned(entries, symmetries)
    pose, covariance, distance = _solve(entries, _medoid(entries))
    good = present & (distance <= CONTRADICTION)
    kept = _kept(present, good, principal, own_image_stays)
    rows = np.flatnonzero((kept != present).any(axis=(1, 2)))
    if len(rows):
        some = entries.select(rows, kept)
        pose[rows], covariance[rows], again = _solve(some, _medoid(some))
        agrees = kept[rows] & (again <= CONTRADICTION)
        needed = agrees[:, :1] if own_image_stays else agrees
        kept[rows] = np.where(needed.any(axis=(1, 2), keepdims=True), agrees, kept[rows])
    parallax = _parallax(entries, kept)
    return FusedPoses(pose, covariance, kept, present & ~kept, parallax, entries.pose)


def _any(given: ndarray) -> Bool[ndarray, "n v"]:
    """Return which views have something."""
    return np.asarray(given.any(axis=2))


def _check(view_T_obj: ndarray, cam_T_view: ndarray, present: ndarray, spread: ndarray) -> None:
    n, v, k = present.shape
    wanted = {"view_T_obj": (n, v, k, 4, 4), "cam_T_view": (n, v, 4, 4), "spread": (n, k, 4)}
    given = {"view_T_obj": view_T_obj, "cam_T_view": cam_T_view, "spread": spread}
    for name, shape in wanted.items():
        if given[name].shape != shape:
            raise InputError(f"fuse_poses: {name} should be {shape}, not {given[name].shape}")
    if not present[:, 0].any(axis=1).all():
        raise InputError("fuse_poses: an instance has no estimate in the judged image (view 0)")
    if not (np.isfinite(view_T_obj[present]).all() and np.isfinite(cam_T_view).all()):
        raise InputError("fuse_poses: a pose holds numbers that are not finite")


def _entries(
    view_T_obj: ndarray,
    cam_T_view: ndarray,
    present: ndarray,
    spread: ndarray,
    noise: ndarray,
) -> _Entries:
    anywhere = np.eye(4)
    anywhere[2, 3] = 1.0
    local = np.where(present[..., None, None], view_T_obj, anywhere)
    pose = compose(cam_T_view[:, :, None], local)
    t = local[..., :3, 3]
    distance = np.linalg.norm(t, axis=-1, keepdims=True)
    ray = np.einsum("nvij,nvkj->nvki", cam_T_view[..., :3, :3], t / distance)
    variance = np.broadcast_to(spread[:, None, :, :3] ** 2, (*present.shape, 3)).copy()
    variance[..., :2] *= distance**2
    share = np.clip(spread[:, None, :, 3:], 0.0, 1 - _LEAST_OWN)
    there = present[..., None]
    count = np.maximum(present.sum(axis=2), 1)[..., None]
    shared = (variance * share * there).sum(axis=2) / count
    far = (distance * there).sum(axis=2) / count
    moved, turned = np.moveaxis(noise[:, 1:] ** 2, -1, 0)
    shared[:, 1:, 0] += moved + turned * far[:, 1:, 0] ** 2
    shared[:, 1:, 1] += moved
    shared[:, 1:, 2] += turned
    mean = (ray * there).sum(axis=2) + np.where(_any(present)[..., None], 0.0, [0, 0, 1.0])
    view_ray = mean / np.linalg.norm(mean, axis=-1, keepdims=True)
    return _Entries(pose, ray, present, variance * (1 - share), shared, view_ray)


def _moved(entries: _Entries, covariance: ndarray) -> _Entries:
    """Add the uncertainty of the motion where each view carries the object."""
    there = entries.present[..., None]
    count = np.maximum(there.sum(axis=2), 1)
    position = (entries.pose[..., :3, 3] * there).sum(axis=2) / count
    shared = entries.shared.copy()
    shared[..., 2] += np.trace(covariance[..., 3:, 3:], axis1=-2, axis2=-1) / 3
    return replace(entries, shared=shared, moved=carried_covariance(covariance, position))


def _turned(entries: _Entries, symmetries: Sequence[ndarray] | None) -> _Entries:
    """Replace each pose by its symmetric equivalent nearest to the instance's medoid."""
    if symmetries is None:
        return entries
    n = len(entries.pose)
    if len(symmetries) != n:
        raise InputError(f"fuse_poses: symmetries of {len(symmetries)} objects for {n} instances")
    groups: dict[int, list[int]] = {}
    for i, one in enumerate(symmetries):
        if len(one) > 1:
            groups.setdefault(id(one), []).append(i)
    if not groups:
        return entries
    pose = entries.pose.copy()
    turned = replace(entries, pose=pose)
    # Twice: rotations that are not yet comparable may have misled the first medoid.
    for _ in range(2):
        for members in groups.values():
            rows = np.array(members)
            base = _medoid(turned.select(rows, entries.present))[:, None, None]
            to = compose(invert(base), pose[rows])
            pose[rows] = compose(base, nearest_symmetric(to, symmetries[members[0]]))
    return turned


def _medoid(entries: _Entries) -> Float[ndarray, "n 4 4"]:
    """Return the estimate that is nearest to the others, by logarithmic distances."""
    n = len(entries.pose)
    pose = entries.pose.reshape(n, -1, 4, 4)
    there = entries.present.reshape(n, -1)
    t, R = pose[..., :3, 3], pose[..., :3, :3].reshape(n, -1, 9)
    far = np.linalg.norm(t[:, :1], axis=-1)[..., None]
    apart = np.linalg.norm(t[:, :, None] - t[:, None], axis=-1) / (_MEDOID_SCALE[0] * far)
    cosine = np.clip((R @ np.swapaxes(R, 1, 2) - 1) / 2, -1, 1)
    cost = np.log1p(apart + np.arccos(cosine) / _MEDOID_SCALE[1]) * there[:, None]
    total = np.where(there, cost.sum(axis=2), np.inf)
    return pose[np.arange(n), total.argmin(axis=1)]


def _solve(entries: _Entries, start: Float[ndarray, "n 4 4"]) -> tuple[ndarray, ndarray, ndarray]:
    """Return poses, covariances, and each estimate's squared Mahalanobis distance."""
    x, R = start[:, :3, 3].copy(), start[:, :3, :3].copy()
    t, full = entries.pose[..., :3, 3], entries.own + entries.shared[:, :, None]
    weight = entries.present.astype(float)
    turn = np.zeros_like(t)
    for _ in range(_ITERATIONS):
        distance, turn = _distances(entries, full, x, R)
        weight = entries.present / (1 + distance / _DIMENSIONS)
        step = _position(entries, weight, t - x[:, None, None])[0]
        about = _rotation(entries, weight, turn)[0]
        x, R = x + step, rotation_from_vector(about) @ R
        if max(np.abs(step).max(), np.abs(about).max()) < _CONVERGED:
            break
    distance, turn = _distances(entries, full, x, R)
    weight = entries.present / (1 + distance / _DIMENSIONS)
    covariance = np.zeros((len(x), 6, 6))
    covariance[:, :3, :3] = _position(entries, weight, t - x[:, None, None])[1]
    covariance[:, 3:, 3:] = _rotation(entries, weight, turn)[1][:, None, None] * np.eye(3)
    return transform(R, x), covariance, distance


def _distances(
    entries: _Entries, variance: ndarray, x: ndarray, R: ndarray
) -> tuple[ndarray, ndarray]:
    error = entries.pose[..., :3, 3] - x[:, None, None]
    along = (error * entries.ray).sum(axis=-1) ** 2
    across = np.maximum((error**2).sum(axis=-1) - along, 0.0)
    turn = rotation_vector(entries.pose[..., :3, :3] @ np.swapaxes(R, 1, 2)[:, None, None])
    angle = (turn**2).sum(axis=-1)
    turned = angle / variance[..., 2]
    if entries.moved is None:
        return across / variance[..., 0] + along / variance[..., 1] + turned, turn
    total = _diagonal_in_ray(variance, entries.ray) + entries.moved[:, :, None]
    pull = np.linalg.solve(total, error[..., None])[..., 0]
    return (error * pull).sum(axis=-1) + turned, turn


def _position(entries: _Entries, weight: ndarray, offset: ndarray) -> tuple[ndarray, ndarray]:
    """Return the weighted mean offset and its covariance, (n, 3) and (n, 3, 3).

    First over the estimators of each view, by their own errors, then over the views, to whose
    variance the shared errors add. The covariance is that of a linear estimator with these weights.
    """
    there, top = _any(weight), weight.max(axis=2)
    own = _along_and_across(weight, entries.own, entries.ray)  # (n, V, 3, 3)
    own = np.where(there[..., None, None], own, np.eye(3))
    inverse = np.linalg.inv(own)
    ray, a, b = entries.ray, *(weight / entries.own[..., i] for i in range(2))
    along = (offset * ray).sum(axis=-1)
    pull = (a[..., None] * offset + ((b - a) * along)[..., None] * ray).sum(axis=2)
    mean = (inverse @ pull[..., None])[..., 0]
    shared = _diagonal_in_ray(entries.shared, entries.view_ray)
    shared = shared if entries.moved is None else shared + entries.moved
    scale = np.where(there, top, 1.0)[..., None, None]
    precision = np.where(there[..., None, None], np.linalg.inv(shared / scale + inverse), 0.0)
    total = np.linalg.inv(precision.sum(axis=1))
    step = (total @ (precision @ mean[..., None]).sum(axis=1))[..., 0]
    spread = inverse @ _along_and_across(weight**2, entries.own, ray) @ inverse + shared
    covariance = total @ (precision @ spread @ precision).sum(axis=1) @ total
    return step, (covariance + np.swapaxes(covariance, 1, 2)) / 2


def _along_and_across(weight: ndarray, variance: ndarray, ray: ndarray) -> ndarray:
    """Return the summed information of the estimates of each view, (n, V, 3, 3)."""
    a, b = weight / variance[..., 0], weight / variance[..., 1]
    outer: ndarray = np.swapaxes(ray * (b - a)[..., None], -1, -2) @ ray
    return outer + a.sum(axis=2)[..., None, None] * np.eye(3)


def _diagonal_in_ray(variance: ndarray, ray: ndarray) -> ndarray:
    a, b = variance[..., :1, None], variance[..., 1:2, None]
    out: ndarray = a * np.eye(3) + (b - a) * ray[..., :, None] * ray[..., None, :]
    return out


def _rotation(entries: _Entries, weight: ndarray, turn: ndarray) -> tuple[ndarray, ndarray]:
    """Return the weighted mean rotation vector and its variance per axis, (n, 3) and (n,)."""
    there, top = _any(weight), np.maximum(weight.max(axis=2), 1e-300)
    own = weight / entries.own[..., 2]
    total = np.where(there, own.sum(axis=2), 1.0)
    mean = (own[..., None] * turn).sum(axis=2) / total[..., None]
    shared = entries.shared[..., 2]
    precision = np.where(there, 1 / (shared / top + 1 / total), 0.0)
    everything = precision.sum(axis=1)
    about = (precision[..., None] * mean).sum(axis=1) / everything[:, None]
    spread = (weight**2 / entries.own[..., 2]).sum(axis=2) / total**2 + shared
    return about, (precision**2 * spread).sum(axis=1) / everything**2


def _kept(present: ndarray, good: ndarray, principal: int, stays: bool) -> Bool[ndarray, "n v k"]:
    """Return the estimates that remain, of those that agree with the others."""
    out = good.copy()
    view_good = _any(good)
    # A single view against the judged image: nobody knows which is right, and the judged image
    # shows the present.
    alone = ((view_good.sum(axis=1) <= 1) | stays) & ~view_good[:, 0]
    out[alone] = False
    out[alone, 0] = present[alone, 0]
    lonely = (out.sum(axis=(1, 2)) <= 1) & (present.sum(axis=(1, 2)) > 1)
    lonely &= present[:, 0, principal]
    out[lonely] = False
    out[lonely, 0, principal] = True
    return out


def _parallax(entries: _Entries, used: ndarray) -> Float[ndarray, " n"]:
    there = _any(used)
    rays = entries.view_ray
    apart = np.linalg.norm(rays[:, :, None] - rays[:, None], axis=-1)
    both = there[:, :, None] & there[:, None]
    # Accurate for small angles, unlike arccos.
    return 2 * np.arcsin(np.minimum(np.where(both, apart, 0.0) / 2, 1.0)).max(axis=(1, 2))
