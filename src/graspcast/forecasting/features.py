"""Consensus features: differences between the supporters' and the principal's estimates.

Every column has a name, a unit and a meaning (:func:`describe`). None uses ground truth. A column
of one supporter is named ``name.supporter``, one of two supporters ``name.first.second``, and one
of the principal alone ``name``.

Three sets:

- ``paper``: the six signed differences of Section III-C, principal minus supporter: translation,
  and ZYX Euler angles subtracted without wrapping (about one sample in ten is off by a whole turn).
- ``rich``: differences in the principal's object frame, after the supporter's pose is replaced by
  the nearest one that is equivalent by the object's symmetries; along and across the viewing ray,
  relative to the distance; ADD; differences between supporters; viewing direction and distance.
- ``full``: those, and the differences in the principal's ray frame
  (:mod:`graspcast.pose.ray_frame`), which do not depend on the object, so that a model fitted to
  one object is valid for another.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, pairwise
from typing import Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import ModelInfo, Models
from graspcast.errors import MismatchError, UnknownNameError
from graspcast.estimates.alignment import Estimates
from graspcast.io.arguments import NAME, a, checked, mapping
from graspcast.pose.metrics import add, nearest_symmetric
from graspcast.pose.ray_frame import obj_R_ray, ray_frame, relative
from graspcast.pose.transforms import compose, euler_zyx, invert, norms, rotation_vector

__all__ = [
    "FEATURE_SETS",
    "FeatureSet",
    "Features",
    "consensus_features",
    "describe",
    "features_of",
    "mean_add",
]

FeatureSet = Literal["paper", "rich", "full"]
FEATURE_SETS: tuple[FeatureSet, ...] = ("paper", "rich", "full")

_MEANING = {
    # paper
    "dx": ("m", "principal minus supporter, camera x"),
    "dy": ("m", "principal minus supporter, camera y"),
    "dz": ("m", "principal minus supporter, camera z"),
    "dpsi_x": (
        "rad",
        "Euler angle about x of Rz Ry Rx, principal minus supporter, not wrapped",
    ),
    "dpsi_y": ("rad", "Euler angle about y, principal minus supporter, not wrapped"),
    "dpsi_z": ("rad", "Euler angle about z, principal minus supporter, not wrapped"),
    # rich, a supporter against the principal
    "rot_x": ("rad", "rotation vector of the nearest symmetric supporter, principal's object x"),
    "rot_y": ("rad", "the same, principal's object y"),
    "rot_z": ("rad", "the same, principal's object z"),
    "angle": ("rad", "length of that rotation vector"),
    "off_x": ("m", "supporter's origin in the principal's object frame, x"),
    "off_y": ("m", "supporter's origin in the principal's object frame, y"),
    "off_z": ("m", "supporter's origin in the principal's object frame, z"),
    "ray": ("m", "how much farther along the principal's viewing ray the supporter's origin lies"),
    "ray_rel": ("1", "the same over the principal's distance"),
    "across_rel": (
        "1",
        "distance of the supporter's origin from that ray, over the same distance",
    ),
    "add_rel": ("1", "ADD between principal and supporter, over the object's diameter"),
    # rich, two supporters
    "angle_between": ("rad", "angle between two supporters, nearest over symmetries"),
    "offset_between": ("m", "distance between two supporters' origins"),
    "ray_between": ("m", "the second's origin beyond the first's, along the principal's ray"),
    # rich, the principal alone
    "view_x": ("1", "direction from the object to the camera, principal's object x"),
    "view_y": ("1", "the same, y"),
    "view_z": ("1", "the same, z"),
    "distance": ("m", "distance from the camera to the principal's origin"),
    "add_mean_rel": ("1", "ADD to the supporters, averaged, over the object's diameter"),
    "add_max_rel": ("1", "the largest ADD to a supporter, over the object's diameter"),
    # full, a supporter in the principal's ray frame
    "shift_x": ("1", "supporter's origin from the principal's, over its distance, ray frame x"),
    "shift_y": ("1", "the same, y"),
    "shift_z": ("1", "the same, along the ray"),
    "turn_x": ("rad", "rotation vector from the principal to the nearest symmetric supporter, x"),
    "turn_y": ("rad", "the same, y"),
    "turn_z": ("rad", "the same, about the ray"),
    # full, all estimators
    "mid_shift_x": ("1", "median over the principal (0) and the supporters of shift_x"),
    "mid_shift_y": ("1", "the same of shift_y"),
    "mid_shift_z": ("1", "the same of shift_z"),
    "mid_turn_x": ("rad", "the same of turn_x"),
    "mid_turn_y": ("rad", "the same of turn_y"),
    "mid_turn_z": ("rad", "the same of turn_z"),
    # full, the principal alone: the ray frame seen from its object
    **{
        f"axis_{ray}{axis}": ("1", f"the ray frame's {ray} axis, principal's object {axis}")
        for ray in "xyz"
        for axis in "xyz"
    },
}


@dataclass(frozen=True)
class Features:
    """A table of features: one row for each instance, one column for each name.

    Attributes
    ----------
    names
        Column names, unique.
    values
        (n, d), in the units that :func:`describe` states.
    """

    names: tuple[str, ...]
    values: Float[ndarray, "n d"]

    def __len__(self) -> int:
        return len(self.values)


def describe(name: str) -> tuple[str, str]:
    """Look up the unit and meaning of a feature column.

    Raises
    ------
    UnknownNameError
        Listing the known features.
    """
    stem, *others = name.split(".")
    if stem not in _MEANING:
        raise UnknownNameError("feature", stem, _MEANING)
    unit, meaning = _MEANING[stem]
    return unit, meaning + (f" [{', '.join(others)}]" if others else "")


@lru_cache(maxsize=64)
def _names(which: FeatureSet, supporters: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of a set's columns, in order."""
    one = {
        "paper": ("dx", "dy", "dz", "dpsi_x", "dpsi_y", "dpsi_z"),
        "rich": (
            *("rot_x", "rot_y", "rot_z", "angle", "off_x", "off_y", "off_z"),
            *("ray", "ray_rel", "across_rel", "add_rel"),
        ),
        "full": ("shift_x", "shift_y", "shift_z", "turn_x", "turn_y", "turn_z"),
    }

    def each(kind: FeatureSet) -> list[str]:
        return [f"{stem}.{name}" for name in supporters for stem in one[kind]]

    if which == "paper":
        return tuple(each("paper"))
    between = ("angle_between", "offset_between", "ray_between")
    pairs = list(combinations(supporters, 2))
    rich = each("rich") + [f"{stem}.{a}.{b}" for a, b in pairs for stem in between]
    rich += ["view_x", "view_y", "view_z", "distance", "add_mean_rel", "add_max_rel"]
    if which == "rich":
        return tuple(rich)
    middle = [f"mid_{stem}" for stem in one["full"]]
    return (*rich, *each("full"), *middle, *(f"axis_{r}{x}" for r in "xyz" for x in "xyz"))


def _side_by_side(parts: Float[ndarray, "k n c"]) -> Float[ndarray, "n kc"]:
    """Put the columns of k supporters or pairs into one row for each instance."""
    k, n, c = parts.shape
    return parts.swapaxes(0, 1).reshape(n, k * c)


def _paper(poses: Float[ndarray, "k n 4 4"]) -> Float[ndarray, "n d"]:
    turns = euler_zyx(poses[..., :3, :3])
    shift, turn = poses[:1, :, :3, 3] - poses[1:, :, :3, 3], turns[:1] - turns[1:]
    return _side_by_side(np.concatenate([shift, turn], axis=-1))


def _rich(
    poses: Float[ndarray, "k n 4 4"],
    symmetries: Float[ndarray, "s 4 4"],
    adds: Float[ndarray, "n k_less_1"],
    which: FeatureSet,
) -> Float[ndarray, "n d"]:
    """Compute the rich or full columns of one object.

    Parameters
    ----------
    poses
        The principal's and the supporters', (K, n, 4, 4).
    symmetries
        The object's.
    adds
        ADD over diameter, (n, K - 1).
    which
        ``rich`` or ``full``.
    """
    principal, k = poses[0], len(poses) - 1
    position = principal[:, :3, 3]
    distance = norms(position)
    # A principal at the camera's centre has no ray; the optical axis is used.
    safe = np.where(distance > 0, distance, 1.0)
    ray = np.where(distance > 0, position / safe, [0.0, 0.0, 1.0])

    # All differences at once: principal to each supporter, then between pairs of supporters.
    start, end = map(list, zip(*combinations(range(k + 1), 2), strict=True))
    near = nearest_symmetric(compose(invert(poses)[start], poses[end]), symmetries)
    turn = rotation_vector(near[..., :3, :3])
    angle = norms(turn)
    shift = poses[end, :, :3, 3] - poses[start, :, :3, 3]
    along = np.add.reduce(shift * ray, axis=-1, keepdims=True)
    across = norms(shift[:k] - along[:k] * ray)
    each = (turn[:k], angle[:k], near[:k, :, :3, 3], along[:k], along[:k] / safe, across / safe)
    between = (angle[k:], norms(shift[k:]), along[k:])
    columns = [
        _side_by_side(np.concatenate([*each, adds.T[..., None]], axis=-1)),
        _side_by_side(np.concatenate(between, axis=-1)),
        -np.einsum("nij,ni->nj", principal[:, :3, :3], ray),
        distance,
        adds.mean(axis=1, keepdims=True),
        adds.max(axis=1, keepdims=True),
    ]
    if which == "full":
        columns += _rays(principal, near[:k])
    return np.concatenate(columns, axis=1)


def _rays(
    principal: Float[ndarray, "n 4 4"], near: Float[ndarray, "k n 4 4"]
) -> list[Float[ndarray, "n _"]]:
    """Compute the columns that ``full`` has beyond ``rich``, of one object.

    Parameters
    ----------
    principal
        The principal's poses, (n, 4, 4).
    near
        The nearest symmetric poses of the supporters in the principal's object frame.
    """
    frame = ray_frame(principal)
    seen = relative(principal, compose(principal, near), frame)
    ordered = np.sort(np.concatenate([np.zeros_like(seen[:1]), seen]), axis=0)
    middle = (ordered[len(near) // 2] + ordered[(len(near) + 1) // 2]) / 2
    axes = obj_R_ray(principal, frame).swapaxes(1, 2)
    return [_side_by_side(seen), middle, axes.reshape(-1, 9)]


def _runs(*columns: ndarray) -> Iterator[slice | ndarray]:
    """Yield the rows of each distinct combination of values."""
    if len(columns[0]) == 1:
        yield slice(None)
        return
    _, group = np.unique(np.stack([c.astype(str) for c in columns]), axis=1, return_inverse=True)
    order = np.argsort(group, kind="stable")
    edges = [0, *(np.flatnonzero(np.diff(group[order])) + 1).tolist(), len(order)]
    for start, stop in pairwise(edges):
        yield order[start:stop]


def _models_of(models: Mapping[str, Models], dataset: str) -> Models:
    if dataset not in models:
        raise MismatchError(
            f"no object models for dataset {dataset!r}; there are models of: "
            f"{', '.join(models) or 'none'}",
            parameters=("bop", "models"),
        )
    return models[dataset]


def mean_add(
    estimates: Estimates, principal: str, models: Mapping[str, Models]
) -> Float[ndarray, " n"]:
    """Compute the mean over supporters of ADD between the principal's pose and theirs, in metres.

    Plain ADD also for symmetric objects, as in Section V-B of the paper.

    References
    ----------
    G. Shi et al., *Fast Uncertainty Quantification for Deep Object Pose Estimation*, ICRA 2021.
    """
    out = np.empty(len(estimates))
    for rows, _, _, adds in _adds(estimates, principal, models):
        out[rows] = adds.mean(axis=1)
    return out


def _adds(
    estimates: Estimates, principal: str, models: Mapping[str, Models]
) -> Iterator[tuple[slice | ndarray, ndarray, ModelInfo, ndarray]]:
    """Yield each object's rows, poses (principal's first), model, and ADDs, (m, K - 1)."""
    every = estimates.only(principal, *estimates.supporters(principal)).cam_T_obj
    for rows in _runs(estimates.dataset, estimates.obj_id):
        dataset, obj_id = str(estimates.dataset[rows][0]), int(estimates.obj_id[rows][0])
        models_of = _models_of(models, dataset)
        poses = every[:, rows]
        adds = add(poses[:1], poses[1:], models_of.mesh(obj_id).points)
        yield rows, poses, models_of[obj_id], np.ascontiguousarray(adds.T)


@checked(estimates=a(Estimates), principal=NAME, which=NAME, models=mapping(a(Models), "dataset"))
def consensus_features(
    estimates: Estimates,
    principal: str,
    *,
    which: FeatureSet = "paper",
    models: Mapping[str, Models] | None = None,
) -> Features:
    """Compute the features of every instance.

    Parameters
    ----------
    estimates
        K estimators' poses.
    principal
        The estimator that would guide the grasp.
    which
        ``paper``, ``rich`` or ``full``.
    models
        Dataset's name to its object models, for ``rich`` and ``full``.

    Raises
    ------
    UnknownNameError
        For a principal, an object or a feature set that is not known.
    MismatchError
        If the models of a dataset are needed and missing.
    """
    names = estimates.supporters(principal)
    if which == "paper":
        return Features(_names(which, names), _paper(estimates.only(principal, *names).cam_T_obj))
    if which not in FEATURE_SETS:
        raise UnknownNameError("feature set", which, FEATURE_SETS)
    out = Features(_names(which, names), np.empty((len(estimates), len(_names(which, names)))))
    for rows, poses, info, adds in _adds(estimates, principal, models or {}):
        out.values[rows] = _rich(poses, info.symmetries, adds / info.diameter_m, which)
    return out


def features_of(
    estimates: Estimates, principal: str, which: str, models: Mapping[str, Models] | None
) -> Features:
    """Compute the features of a model card: a set's name, or ``add`` for the mean ADD alone."""
    if which == "add":
        return Features(("add_mean",), mean_add(estimates, principal, models or {})[:, None])
    named: FeatureSet = which  # type: ignore[assignment]
    return consensus_features(estimates, principal, which=named, models=models)
