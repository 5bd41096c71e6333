"""Batches of rigid transforms.

A transform ``a_T_b`` is a 4x4 float64 matrix that maps points of frame b into frame a; every
function takes and returns batches with any leading shape, ``(..., 4, 4)``. Metres and radians;
quaternions are wxyz with a non-negative real part.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

__all__ = [
    "compose",
    "euler_zyx",
    "exp",
    "invert",
    "is_identity",
    "log",
    "norms",
    "project_to_rotation",
    "quaternion",
    "rotation_angle",
    "rotation_from_quaternion",
    "rotation_from_vector",
    "rotation_vector",
    "skew",
    "transform",
    "transform_points",
]

_SMALL_ANGLE = 1e-6
_DIAGONAL_SIGNS = np.array(
    [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]
)
"""Of a rotation's diagonal in four times the squares of its quaternion's components."""
_FIRST = np.array([[0, 7, 2, 3], [7, 0, 3, 2], [2, 3, 0, 7], [3, 2, 7, 0]])
_SECOND = np.array([[0, 5, 6, 1], [5, 0, 1, 6], [6, 1, 0, 5], [1, 6, 5, 0]])
_SIGN = np.array(
    [[1.0, -1.0, -1.0, -1.0], [-1.0, 1.0, 1.0, 1.0], [-1.0, 1.0, 1.0, 1.0], [-1.0, 1.0, 1.0, 1.0]]
)
"""The products of two different components, times four: one entry of a rotation, row by row, plus
or minus another."""


def norms(vectors: Float[ndarray, "*batch d"]) -> Float[ndarray, "*batch 1"]:
    """Compute Euclidean norms, as ``np.linalg.norm`` in a fraction of its time for a few rows."""
    lengths: ndarray = np.sqrt(np.add.reduce(vectors * vectors, axis=-1, keepdims=True))
    return lengths


def transform(
    rotation: Float[ndarray, "*#batch 3 3"], translation: Float[ndarray, "*#batch 3"]
) -> Float[ndarray, "*batch 4 4"]:
    """Build transforms from rotation matrices and translations in metres."""
    batch = rotation.shape[:-2]
    if translation.shape[:-1] != batch:
        batch = np.broadcast_shapes(batch, translation.shape[:-1])
    out = np.zeros((*batch, 4, 4))
    out[..., :3, :3] = rotation
    out[..., :3, 3] = translation
    out[..., 3, 3] = 1.0
    return out


def compose(
    first: Float[ndarray, "*#batch 4 4"], *others: Float[ndarray, "*#batch 4 4"]
) -> Float[ndarray, "*batch 4 4"]:
    """Multiply transforms from left to right: ``a_T_b, b_T_c, …`` to ``a_T_z``."""
    for other in others:
        first = first @ other
    return first


def invert(a_T_b: Float[ndarray, "*batch 4 4"]) -> Float[ndarray, "*batch 4 4"]:
    """Invert transforms, ``a_T_b`` to ``b_T_a``, by transposing the rotation."""
    rotation = a_T_b[..., :3, :3].swapaxes(-1, -2)
    return transform(rotation, -np.einsum("...ij,...j->...i", rotation, a_T_b[..., :3, 3]))


def transform_points(
    a_T_b: Float[ndarray, "*batch 4 4"], points_b: Float[ndarray, "v 3"]
) -> Float[ndarray, "*batch v 3"]:
    """Map the same points (metres) by every transform of the batch."""
    rotated: ndarray = points_b @ np.swapaxes(a_T_b[..., :3, :3], -1, -2)
    return rotated + a_T_b[..., None, :3, 3]


def is_identity(a_T_b: Float[ndarray, "*batch 4 4"]) -> Bool[ndarray, "*batch"]:
    """Test where a transform is exactly the identity, the placeholder for "nothing found"."""
    return np.asarray(np.all(a_T_b == np.eye(4), axis=(-2, -1)))


def quaternion(rotation: Float[ndarray, "*batch 3 3"]) -> Float[ndarray, "*batch 4"]:
    """Convert rotation matrices to unit quaternions wxyz with w >= 0.

    Shepperd's method: the signs are relative to the largest component, so that no division is by
    a small number.

    References
    ----------
    S. W. Shepperd, *Quaternion from rotation matrix*, Journal of Guidance and Control, 1978.
    """
    r = rotation.reshape(-1, 9)
    # Rows of 4 q q^T, one for each choice of the leading component; its diagonal is 4 q^2.
    outer = r.take(_FIRST, axis=1) + _SIGN * r.take(_SECOND, axis=1)
    signed = _DIAGONAL_SIGNS * r[:, None, ::4]
    squares = 1 + signed[..., 0] + signed[..., 1] + signed[..., 2]
    outer.reshape(-1, 16)[:, ::5] = squares
    q = outer[np.arange(len(r)), squares.argmax(axis=1)]
    q /= norms(q)
    return np.where(q[:, :1] < 0, -q, q).reshape(*rotation.shape[:-2], 4)


def rotation_from_quaternion(q: Float[ndarray, "*batch 4"]) -> Float[ndarray, "*batch 3 3"]:
    """Convert quaternions wxyz of any non-zero length to rotation matrices."""
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    out = np.empty((*q.shape[:-1], 3, 3))
    out[..., 0, 0] = 1 - 2 * (y * y + z * z)
    out[..., 0, 1] = 2 * (x * y - w * z)
    out[..., 0, 2] = 2 * (x * z + w * y)
    out[..., 1, 0] = 2 * (x * y + w * z)
    out[..., 1, 1] = 1 - 2 * (x * x + z * z)
    out[..., 1, 2] = 2 * (y * z - w * x)
    out[..., 2, 0] = 2 * (x * z - w * y)
    out[..., 2, 1] = 2 * (y * z + w * x)
    out[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return out


def rotation_angle(rotation: Float[ndarray, "*batch 3 3"]) -> Float[ndarray, "*batch"]:
    """Compute the angle of a rotation in [0, pi]; accurate near 0 and near pi, unlike arccos."""
    q = quaternion(rotation)
    return np.asarray(2.0 * np.arctan2(norms(q[..., 1:])[..., 0], q[..., 0]))


def rotation_vector(rotation: Float[ndarray, "*batch 3 3"]) -> Float[ndarray, "*batch 3"]:
    """Convert rotation matrices to rotation vectors: the axis times the angle in [0, pi]."""
    q = quaternion(rotation)
    sine = norms(q[..., 1:])
    angle = 2.0 * np.arctan2(sine, q[..., :1])
    # angle / sine tends to 2 at the identity.
    factor = np.where(sine > _SMALL_ANGLE, angle / np.maximum(sine, _SMALL_ANGLE), 2.0)
    return factor * q[..., 1:]


def skew(v: Float[ndarray, "*batch 3"]) -> Float[ndarray, "*batch 3 3"]:
    """Return the matrices that take the cross product of vectors with another: ``v x w``."""
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    rows = [[o, -z, y], [z, o, -x], [-y, x, o]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_from_vector(vector: Float[ndarray, "*batch 3"]) -> Float[ndarray, "*batch 3 3"]:
    """Convert rotation vectors (radians) to rotation matrices."""
    half = 0.5 * np.linalg.norm(vector, axis=-1, keepdims=True)
    # np.sinc(x) is sin(pi x) / (pi x), smooth through zero.
    return rotation_from_quaternion(
        np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * vector], axis=-1)
    )


def log(a_T_b: Float[ndarray, "*batch 4 4"]) -> Float[ndarray, "*batch 6"]:
    """Compute the logarithm of rigid transforms, the inverse of :func:`exp`.

    The rotation angle must be below pi.

    Returns
    -------
    Twists: the translation part (3, metres), then the rotation vector (3, radians).

    References
    ----------
    T. D. Barfoot, *State Estimation for Robotics*, eq. 7.95.
    """
    phi = rotation_vector(a_T_b[..., :3, :3])
    angle = np.linalg.norm(phi, axis=-1)[..., None, None]
    k = skew(phi)
    safe = np.maximum(angle, 1e-4)
    # Inverse of the left Jacobian; its series starts at 1/12.
    quadratic = np.where(
        angle > 1e-4, (1 - 0.5 * safe / np.tan(0.5 * safe)) / (safe * safe), 1.0 / 12.0
    )
    inverse_jacobian = np.eye(3) - 0.5 * k + quadratic * (k @ k)
    rho = np.einsum("...ij,...j->...i", inverse_jacobian, a_T_b[..., :3, 3])
    return np.concatenate([rho, phi], axis=-1)


def exp(twist: Float[ndarray, "*batch 6"]) -> Float[ndarray, "*batch 4 4"]:
    """Compute the rigid transforms of twists (translation part, rotation vector)."""
    rho, phi = twist[..., :3], twist[..., 3:]
    angle = np.linalg.norm(phi, axis=-1)[..., None, None]
    k = skew(phi)
    safe = np.maximum(angle, 1e-4)
    linear = np.where(angle > 1e-4, (1 - np.cos(safe)) / (safe * safe), 0.5)
    quadratic = np.where(angle > 1e-4, (safe - np.sin(safe)) / safe**3, 1.0 / 6.0)
    jacobian = np.eye(3) + linear * k + quadratic * (k @ k)
    return transform(rotation_from_vector(phi), np.einsum("...ij,...j->...i", jacobian, rho))


def euler_zyx(rotation: Float[ndarray, "*batch 3 3"]) -> Float[ndarray, "*batch 3"]:
    """Compute Euler angles (x, y, z), radians, with ``R = Rz(z) Ry(y) Rx(x)``; x, z in (-pi, pi].

    At the singularity (y = ±pi/2) z is zero.
    """
    r = rotation
    cosine = np.hypot(r[..., 0, 0], r[..., 1, 0])
    singular = cosine < 1e-6
    x = np.where(
        singular,
        np.arctan2(-r[..., 1, 2], r[..., 1, 1]),
        np.arctan2(r[..., 2, 1], r[..., 2, 2]),
    )
    y = np.arctan2(-r[..., 2, 0], cosine)
    z = np.where(singular, 0.0, np.arctan2(r[..., 1, 0], r[..., 0, 0]))
    return np.stack([x, y, z], axis=-1)


def project_to_rotation(matrix: Float[ndarray, "*batch 3 3"]) -> Float[ndarray, "*batch 3 3"]:
    """Find the nearest rotation to each matrix in the Frobenius norm (orthogonal Procrustes)."""
    u, _, vt = np.linalg.svd(matrix)
    sign = np.ones(matrix.shape[:-1])
    sign[..., 2] = np.linalg.det(u @ vt)
    return (u * sign[..., None, :]) @ vt
