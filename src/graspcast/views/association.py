"""Association: which of several instances of an object in one image is which in another."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.pose.metrics import nearest_symmetric
from graspcast.pose.transforms import compose, invert, rotation_angle
from graspcast.views.camera_motion import CameraNoise
from graspcast.views.fusion import CONTRADICTION

__all__ = ["associate", "associate_views", "pair_distances", "position_covariance"]

_DOUBT = 9.0
"""Two associations whose squared Mahalanobis distances differ by less are both plausible."""
_SAME = 1.0
"""Two estimates nearer than this are of one instance, and either may serve."""
_MOST_BY_ROTATION = CONTRADICTION / 2
"""A wrong rotation alone does not make it another instance."""


def position_covariance(
    position: Float[ndarray, "m 3"], spread: Float[ndarray, "4"], noise: CameraNoise | None = None
) -> Float[ndarray, "m 3 3"]:
    """Return the covariance of positions in a camera's frame, m², and of the camera's motion."""
    noise = noise or CameraNoise()
    distance = np.linalg.norm(position, axis=1)
    ray = position / distance[:, None]
    across = (spread[0] ** 2 + noise.rotation_rad**2) * distance**2 + noise.translation_m**2
    along = (spread[1] * distance) ** 2 + noise.translation_m**2
    outer = ray[:, :, None] * ray[:, None, :]
    out: ndarray = across[:, None, None] * np.eye(3) + (along - across)[:, None, None] * outer
    return out


def pair_distances(
    first: Float[ndarray, "a 4 4"],
    first_covariance: Float[ndarray, "a 3 3"],
    second: Float[ndarray, "b 4 4"],
    second_covariance: Float[ndarray, "b 3 3"],
    rotation_rad: float,
    symmetries: Float[ndarray, "s 4 4"],
) -> Float[ndarray, "a b"]:
    """Return squared Mahalanobis distances between poses in one frame.

    Position within the sum of the covariances, and the smallest angle over the symmetries, whose
    part is limited.
    """
    error = first[:, None, :3, 3] - second[None, :, :3, 3]
    total = first_covariance[:, None] + second_covariance[None]
    position = np.einsum("abi,abi->ab", error, np.linalg.solve(total, error[..., None])[..., 0])
    between = nearest_symmetric(compose(invert(first)[:, None], second[None]), symmetries)
    angle = rotation_angle(between[..., :3, :3])
    turned = np.minimum((angle / rotation_rad) ** 2 / 2, _MOST_BY_ROTATION)
    return np.asarray(position + turned)


def associate(
    distances: Float[ndarray, "a b"],
    among_first: Float[ndarray, "a a"],
    among_second: Float[ndarray, "b b"],
) -> tuple[Int[ndarray, " a"], Bool[ndarray, " a"]]:
    """Assign the estimates of one image to those of another, and say where it is doubted.

    Parameters
    ----------
    distances
        Between a estimates of the judged image and b of the other, of :func:`pair_distances`.
    among_first, among_second
        The same within each image: by these, double detections are recognised.

    Returns
    -------
    The number of the estimate that belongs to each of the first, -1 if none does; and where another
    association is as plausible. There it is -1 too: nothing is guessed.
    """
    from scipy.optimize import linear_sum_assignment

    a, b = distances.shape
    out, doubted = np.full(a, -1), np.zeros(a, dtype=bool)
    if not a or not b:
        return out, doubted
    # Beyond the gate all are alike: a far one must not decide where the near ones go.
    rows, columns = linear_sum_assignment(np.minimum(distances, CONTRADICTION))
    owner = {}
    for r, c in zip(rows.tolist(), columns.tolist(), strict=True):
        if (mine := distances[r, c]) > CONTRADICTION:
            continue
        owner[c] = r
        in_row = (distances[r] < mine + _DOUBT) & (distances[r] <= CONTRADICTION)
        in_column = (distances[:, c] < mine + _DOUBT) & (distances[:, c] <= CONTRADICTION)
        other_c = in_row & (among_second[c] > _SAME) & (np.arange(b) != c)
        other_r = in_column & (among_first[r] > _SAME) & (np.arange(a) != r)
        doubted[r] = bool(other_c.any() or other_r.any())
        if not doubted[r]:
            out[r] = c
    for r in sorted(set(range(a)) - set(owner.values())):
        # Its nearest went to another one: is that sure, or are these two for one estimate?
        c = int(distances[r].argmin())
        if distances[r, c] <= CONTRADICTION and c in owner:
            doubted[r] = distances[r, c] < distances[owner[c], c] + _DOUBT
    return out, doubted


def associate_views(
    cam_T_obj: Float[ndarray, "a 4 4"],
    view_T_obj: Float[ndarray, "b 4 4"],
    cam_T_view: Float[ndarray, "4 4"],
    spread: tuple[Float[ndarray, "4"], Float[ndarray, "4"]],
    noise: CameraNoise,
    symmetries: Float[ndarray, "s 4 4"],
) -> tuple[Int[ndarray, " a"], Bool[ndarray, " a"]]:
    """Associate the estimates of one object in the judged image with those in another view.

    Parameters
    ----------
    cam_T_obj, view_T_obj
        In the judged image and in the view, each in its own camera's frame.
    cam_T_view
        The motion between both, with its ``noise``.
    spread
        Across, along, rotation and shared of the estimator of either.
    symmetries
        Of the object.

    Returns
    -------
    See :func:`associate`.
    """
    mine, other = spread
    turn = cam_T_view[:3, :3]
    first = position_covariance(cam_T_obj[:, :3, 3], mine)
    second = turn @ position_covariance(view_T_obj[:, :3, 3], other, noise) @ turn.T
    sides = {"a": (cam_T_obj, first), "b": (compose(cam_T_view[None], view_T_obj), second)}
    angle = float(np.hypot(mine[2], other[2]) / np.sqrt(2) + noise.rotation_rad)
    between, of_first, of_second = (
        pair_distances(*sides[i], *sides[j], angle, symmetries) for i, j in ("ab", "aa", "bb")
    )
    return associate(between, of_first, of_second)
