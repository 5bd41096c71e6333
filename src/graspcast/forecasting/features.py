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
from itertools import chain, combinations, pairwise
from typing import Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import MismatchError, UnknownNameError
from graspcast.estimates.alignment import Estimates
from graspcast.io.arguments import NAME, a, checked, mapping
from graspcast.pose.metrics import add, nearest_symmetric
from graspcast.pose.ray_frame import obj_R_ray, relative
from graspcast.pose.transforms import compose, euler_zyx, invert, rotation_vector

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


Columns = Iterator[tuple[str, ndarray]]


def _paper(principal: ndarray, supporters: Mapping[str, ndarray]) -> Columns:
    for name, supporter in supporters.items():
        shift = principal[:, :3, 3] - supporter[:, :3, 3]
        turn = euler_zyx(principal[:, :3, :3]) - euler_zyx(supporter[:, :3, :3])
        for axis, column in zip("xyz", shift.T, strict=True):
            yield f"d{axis}.{name}", column
        for axis, column in zip("xyz", turn.T, strict=True):
            yield f"dpsi_{axis}.{name}", column


def _rich(
    principal: ndarray, supporters: Mapping[str, ndarray], symmetries: ndarray, adds: ndarray
) -> Columns:
    """Compute the rich columns of one object; ``adds`` is ADD over diameter, (n, K - 1)."""
    distance = np.linalg.norm(principal[:, :3, 3], axis=-1)
    # A principal at the camera's centre has no ray; the optical axis is used.
    safe = np.where(distance > 0, distance, 1.0)
    ray = np.where(distance[:, None] > 0, principal[:, :3, 3] / safe[:, None], [0.0, 0.0, 1.0])

    # All differences at once: principal to each supporter, then between pairs of supporters.
    names, poses = list(supporters), np.stack([principal, *supporters.values()])
    k = len(names)
    pairs = [(0, i + 1) for i in range(k)] + list(combinations(range(1, k + 1), 2))
    start, end = (list(side) for side in zip(*pairs, strict=True))
    near = nearest_symmetric(compose(invert(poses)[start], poses[end]), symmetries)
    turn = rotation_vector(near[..., :3, :3])
    angle = np.linalg.norm(turn, axis=-1)
    shift = poses[end][..., :3, 3] - poses[start][..., :3, 3]
    along = np.sum(shift * ray, axis=-1)

    for i, name in enumerate(names):
        across = np.linalg.norm(shift[i] - along[i][:, None] * ray, axis=-1)
        for axis, column in zip("xyz", turn[i].T, strict=True):
            yield f"rot_{axis}.{name}", column
        yield f"angle.{name}", angle[i]
        for axis, column in zip("xyz", near[i, :, :3, 3].T, strict=True):
            yield f"off_{axis}.{name}", column
        yield f"ray.{name}", along[i]
        yield f"ray_rel.{name}", along[i] / safe
        yield f"across_rel.{name}", across / safe
        yield f"add_rel.{name}", adds[:, i]
    for i in range(k, len(pairs)):
        pair = f"{names[start[i] - 1]}.{names[end[i] - 1]}"
        yield f"angle_between.{pair}", angle[i]
        yield f"offset_between.{pair}", np.linalg.norm(shift[i], axis=-1)
        yield f"ray_between.{pair}", along[i]
    view = -np.einsum("nij,ni->nj", principal[:, :3, :3], ray)
    for axis, column in zip("xyz", view.T, strict=True):
        yield f"view_{axis}", column
    yield "distance", distance
    yield "add_mean_rel", adds.mean(axis=1)
    yield "add_max_rel", adds.max(axis=1)


def _rays(principal: ndarray, supporters: Mapping[str, ndarray], symmetries: ndarray) -> Columns:
    """Compute the columns that ``full`` has beyond ``rich``, of one object."""
    poses = np.stack(list(supporters.values()))
    near = nearest_symmetric(compose(invert(principal), poses), symmetries)
    seen = relative(principal, compose(principal, near))
    for name, differences in zip(supporters, seen, strict=True):
        for kind, part in (("shift", differences[:, :3]), ("turn", differences[:, 3:])):
            for axis, column in zip("xyz", part.T, strict=True):
                yield f"{kind}_{axis}.{name}", column
    middle = np.median(np.concatenate([np.zeros_like(seen[:1]), seen]), axis=0)
    for kind, part in (("shift", middle[:, :3]), ("turn", middle[:, 3:])):
        for axis, column in zip("xyz", part.T, strict=True):
            yield f"mid_{kind}_{axis}", column
    axes = obj_R_ray(principal)
    for i, ray in enumerate("xyz"):
        for axis, column in zip("xyz", axes[:, :, i].T, strict=True):
            yield f"axis_{ray}{axis}", column


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
) -> Iterator[tuple[slice | ndarray, str, int, ndarray]]:
    """Yield each object's rows, dataset, number, and ADD to each supporter, (m, K - 1)."""
    pose = estimates.of(principal)
    supporters = [estimates.of(name) for name in estimates.supporters(principal)]
    for rows in _runs(estimates.dataset, estimates.obj_id):
        dataset, obj_id = str(estimates.dataset[rows][0]), int(estimates.obj_id[rows][0])
        points = _models_of(models, dataset).mesh(obj_id).vertices
        adds = [add(pose[rows], supporter[rows], points) for supporter in supporters]
        yield rows, dataset, obj_id, np.stack(adds, axis=1)


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
    pose = estimates.of(principal)
    supporters = {name: estimates.of(name) for name in estimates.supporters(principal)}
    if which == "paper":
        return _stack(_paper(pose, supporters))
    if which not in FEATURE_SETS:
        raise UnknownNameError("feature set", which, FEATURE_SETS)
    models = models or {}
    out: Features | None = None
    for rows, dataset, obj_id, adds in _adds(estimates, principal, models):
        info = _models_of(models, dataset)[obj_id]
        seen = {name: poses[rows] for name, poses in supporters.items()}
        columns = _rich(pose[rows], seen, info.symmetries, adds / info.diameter_m)
        if which == "full":
            columns = chain(columns, _rays(pose[rows], seen, info.symmetries))
        part = _stack(columns)
        if out is None:
            out = Features(part.names, np.empty((len(estimates), len(part.names))))
        out.values[rows] = part.values
    assert out is not None
    return out


def _stack(columns: Columns) -> Features:
    names, values = zip(*columns, strict=True)
    return Features(names=names, values=np.stack(values, axis=1))


def features_of(
    estimates: Estimates, principal: str, which: str, models: Mapping[str, Models] | None
) -> Features:
    """Compute the features of a model card: a set's name, or ``add`` for the mean ADD alone."""
    if which == "add":
        return Features(("add_mean",), mean_add(estimates, principal, models or {})[:, None])
    named: FeatureSet = which  # type: ignore[assignment]
    return consensus_features(estimates, principal, which=named, models=models)
