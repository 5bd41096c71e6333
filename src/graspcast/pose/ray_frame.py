"""The viewing-ray frame of a pose, and pose errors in it.

A monocular estimator knows the direction to an object better than its distance, and its position
errors are proportional to the distance. The **ray frame** of a pose has its z axis along the ray
from the camera to the object's origin, and its x axis in the plane of that ray and the camera's x
axis. In this frame, another pose of the same object is described by six numbers: the difference of
the origins divided by the distance, and the rotation vector of the relative rotation. These numbers
do not depend on the object's frame, nor (except for the rotation about the ray) on its position in
the image, so an error observed on one object can be applied to another one.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.pose.transforms import norms, rotation_from_vector, rotation_vector, transform

__all__ = ["compressed", "displaced", "error_along", "obj_R_ray", "ray_frame", "relative"]

_SPREAD = np.array([0.003, 0.003, 0.008, 0.07, 0.07, 0.07])
"""Typical magnitudes of the numbers of :func:`relative`."""
_X, _Y, _Z = np.eye(3)
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def ray_frame(cam_T_obj: Float[ndarray, "*batch 4 4"]) -> Float[ndarray, "*batch 3 3"]:
    """Compute ``cam_R_ray`` of each pose; the identity for an object at the camera's centre."""
    position = cam_T_obj[..., :3, 3]
    distance = norms(position)
    there = distance > 0
    z = np.where(there, position / np.where(there, distance, 1.0), _Z)
    # The camera's x axis made perpendicular to the ray; its y axis if x is parallel to the ray.
    along_x = np.abs(z[..., :1]) > 1 - 1e-9
    side = np.where(along_x, _Y, _X)
    x = side - z * np.add.reduce(side * z, axis=-1, keepdims=True)
    x /= norms(x)
    out = np.empty((*z.shape, 3))
    out[..., 0], out[..., 2] = x, z
    # The cross product of z and x.
    out[..., 1] = z.take(_NEXT, -1) * x.take(_LAST, -1) - z.take(_LAST, -1) * x.take(_NEXT, -1)
    return out


def obj_R_ray(
    cam_T_obj: Float[ndarray, "*batch 4 4"], cam_R_ray: Float[ndarray, "*batch 3 3"] | None = None
) -> Float[ndarray, "*batch 3 3"]:
    """Compute the rotation from the ray frame (if it is known, ``cam_R_ray``) to the object's."""
    frame = ray_frame(cam_T_obj) if cam_R_ray is None else cam_R_ray
    return cam_T_obj[..., :3, :3].swapaxes(-1, -2) @ frame


def relative(
    cam_T_obj: Float[ndarray, "*#batch 4 4"],
    other: Float[ndarray, "*#batch 4 4"],
    cam_R_ray: Float[ndarray, "*#batch 3 3"] | None = None,
) -> Float[ndarray, "*batch 6"]:
    """Express another pose of the same object in this pose's ray frame.

    Parameters
    ----------
    cam_T_obj, other
        The two poses.
    cam_R_ray
        :func:`ray_frame` of this pose, where it is known.

    Returns
    -------
    Difference of the origins divided by the distance (3, no unit; the third is along the ray), and
    the rotation vector from this pose to the other (3, radians).
    """
    frame = ray_frame(cam_T_obj) if cam_R_ray is None else cam_R_ray
    position = cam_T_obj[..., :3, 3]
    distance = norms(position)
    shift = np.einsum("...ji,...j->...i", frame, other[..., :3, 3] - position)
    turn = other[..., :3, :3] @ cam_T_obj[..., :3, :3].swapaxes(-1, -2)
    turn = frame.swapaxes(-1, -2) @ turn @ frame
    return np.concatenate(
        [shift / np.where(distance > 0, distance, 1.0), rotation_vector(turn)], axis=-1
    )


def compressed(by: Float[ndarray, "*batch 6"]) -> Float[ndarray, "*batch 6"]:
    """Scale the numbers of :func:`relative` by typical magnitudes, large ones logarithmically."""
    scaled = by / _SPREAD
    return np.sign(scaled) * np.log1p(np.abs(scaled))


def displaced(
    cam_T_obj: Float[ndarray, "*#batch 4 4"], by: Float[ndarray, "*#batch 6"]
) -> Float[ndarray, "*batch 4 4"]:
    """Apply a displacement to a pose, the inverse of :func:`relative`."""
    frame = ray_frame(cam_T_obj)
    distance = np.linalg.norm(cam_T_obj[..., :3, 3], axis=-1, keepdims=True)
    turn = frame @ rotation_from_vector(by[..., 3:]) @ np.swapaxes(frame, -1, -2)
    shift = np.einsum("...ij,...j->...i", frame, by[..., :3]) * distance
    return transform(turn @ cam_T_obj[..., :3, :3], cam_T_obj[..., :3, 3] + shift)


def error_along(
    axes: Float[ndarray, "*#batch 3 3"],
    distance: Float[ndarray, "*#batch"],
    truth: Float[ndarray, "*#batch 6"],
) -> Float[ndarray, "*batch 4 4"]:
    """Compute the error ``obj_T_est`` of an estimate from the true pose in its ray frame.

    Parameters
    ----------
    axes
        Ray frame of the estimate, :func:`obj_R_ray`.
    distance
        Distance from the camera to the estimate's origin, metres.
    truth
        The true pose in that frame: :func:`relative` of the estimate and the true pose.

    Returns
    -------
    ``inv(cam_T_true) @ cam_T_est``, which does not depend on the camera.
    """
    # A = obj_R_ray, D = exp(turn), shift s: R = A Dᵀ Aᵀ, and the origin is at -distance A Dᵀ s.
    back = axes @ np.swapaxes(rotation_from_vector(truth[..., 3:]), -1, -2)
    rotation = back @ np.swapaxes(axes, -1, -2)
    position = -np.einsum("...ij,...j->...i", back, truth[..., :3]) * distance[..., None]
    return transform(rotation, position)
