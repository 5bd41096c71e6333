"""Checks of several estimators' poses of the same instances, before they are compared.

Each pose by itself: :mod:`graspcast.pose.sanity`. Two names of one estimator: poses that are equal
but for rounding. Another convention: :mod:`graspcast.pose.conventions`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.bop.results import Results
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.instances import InstanceKey, Instances
from graspcast.io.arguments import a, refuse_unless
from graspcast.pose.conventions import behind_hint, find_odd_one
from graspcast.pose.sanity import is_placeholder, pose_problems

__all__ = [
    "COPY_TOLERANCE",
    "IncompleteInstance",
    "check_shapes",
    "copied",
    "diameters",
    "impossible",
    "no_estimate_by",
    "none_in_common",
    "problems_by_key",
    "refuse_conventions",
    "refuse_copies",
    "refused",
    "sane_rows",
]

COPY_TOLERANCE = 1e-5
"""Two poses that are nearer are one: rotations' entries, and positions over the distance.

As float32, or written with six digits, a pose changes by less. Those of two of the published
estimators are nowhere nearer than 1.4e-3.
"""


_NAMES, _INSTANCES, _ARRAY = a(tuple, words="a tuple of names"), a(Instances), a(np.ndarray)


@dataclass(frozen=True, eq=False)
class IncompleteInstance:
    """An instance of the anchor's for which some other estimator has no estimate.

    Attributes
    ----------
    key
        Its key.
    missing
        The estimators without an estimate.
    cam_T_obj
        The anchor's pose, metres, (4, 4).
    problems
        What is wrong with the poses of those that gave one: name to words.
    """

    key: InstanceKey
    missing: tuple[str, ...]
    cam_T_obj: Float[ndarray, "4 4"]
    problems: Mapping[str, str] = field(default_factory=dict)

    @property
    def reason(self) -> str:
        """Why there is no forecast, in words."""
        return no_estimate_by(self.missing, self.problems)


def check_shapes(estimators: Any, instances: Any, cam_T_obj: Any) -> None:
    """Raise if these are not the poses of n instances by K estimators.

    Raises
    ------
    InputError
        Naming what is of another kind or shape.
    """
    where = "Estimates"
    refuse_unless(_NAMES, estimators, where, "estimators")
    refuse_unless(_INSTANCES, instances, where, "instances")
    refuse_unless(_ARRAY, cam_T_obj, where, "cam_T_obj")
    wanted = (len(estimators), len(instances), 4, 4)
    if cam_T_obj.shape != wanted or cam_T_obj.dtype.kind != "f":
        raise InputError(
            f"{where}: cam_T_obj should be {wanted} numbers, 4x4 for each of {wanted[0]} "
            f"estimators and {wanted[1]} instances, not {cam_T_obj.shape} of {cam_T_obj.dtype}"
        )


def diameters(
    dataset: Sequence[str], obj_id: Sequence[int], models: Mapping[str, Models] | None
) -> Float[ndarray, " n"]:
    """Return the diameter of each of n objects, metres, NaN where no model is known.

    Parameters
    ----------
    dataset, obj_id
        The objects.
    models
        Dataset's name to its object models.
    """
    pairs = list(zip(dataset, obj_id, strict=True))
    known = {
        (name, number): models[name].info[number].diameter_m
        for name, number in set(pairs)
        if models and name in models and number in models[name].info
    }
    return np.array([known.get(pair, np.nan) for pair in pairs], dtype=np.float64)


def sane_rows(
    results: Mapping[str, Results], dataset: str, models: Mapping[str, Models] | None
) -> tuple[list[Results], list[dict[tuple[int, int, int], str]], tuple[str, ...]]:
    """Leave out the rows whose pose cannot be.

    Parameters
    ----------
    results
        Estimator's name to its results.
    dataset
        The dataset's name.
    models
        Dataset's name to its object models.

    Returns
    -------
        Each estimator's other rows; what is wrong with those left out, except placeholders, by
        scene, image and object; and how many they are, in words.
    """
    tables = list(results.values())
    numbers = np.concatenate([t.obj_id for t in tables]).tolist()
    found = pose_problems(
        np.concatenate([t.cam_T_obj for t in tables]),
        diameters([dataset] * len(numbers), numbers, models),
    )
    if not any(found):
        return tables, [{} for _ in tables], ()
    ends = np.cumsum([len(t) for t in tables]).tolist()
    problems = [found[end - len(t) : end] for t, end in zip(tables, ends, strict=True)]
    good = [np.array([not text for text in said], dtype=bool) for said in problems]
    return (
        [t.select(rows) for t, rows in zip(tables, good, strict=True)],
        list(map(problems_by_key, tables, problems)),
        tuple(filter(None, map(refused, results, tables, problems))),
    )


def impossible(
    cam_T_obj: Float[ndarray, "n 4 4"], keys: Instances, models: Mapping[str, Models] | None
) -> list[str]:
    """Say how many fused poses cannot be, which the other verbs will refuse, or nothing."""
    sizes = diameters(keys.dataset.tolist(), keys.obj_id.tolist(), models)
    bad = [text for text in pose_problems(cam_T_obj, sizes) if text]
    return [f"{len(bad)} fused poses cannot be: one {bad[0]}"] if bad else []


def problems_by_key(results: Results, problems: list[str]) -> dict[tuple[int, int, int], str]:
    """Return what is wrong with poses, other than placeholders, by scene, image and object."""
    return {
        (int(results.scene_id[i]), int(results.im_id[i]), int(results.obj_id[i])): text
        for i, text in enumerate(problems)
        if text and not is_placeholder(results.cam_T_obj[i])
    }


def refused(name: str, results: Results, problems: list[str]) -> str:
    """Say how many of an estimator's poses cannot be, and what is wrong with most, or nothing."""
    empty = is_placeholder(results.cam_T_obj)
    said = [text for text, nothing in zip(problems, empty, strict=True) if text and not nothing]
    if not said:
        return ""
    # Numbers differ from pose to pose; the words before them do not.
    kinds = Counter(" ".join(text.split()[:3]) for text in said)
    kind = kinds.most_common(1)[0][0]
    one = next(text for text in said if text.startswith(kind))
    behind = int((results.cam_T_obj[:, 2, 3] < 0).sum())
    hint = behind_hint(behind, len(results)) if "behind" in one else ""
    return f"{len(said)} of {len(results)} poses by {name} cannot be: one {one}{hint}"


def no_estimate_by(names: Sequence[str], problems: Mapping[str, str]) -> str:
    """Say by whom there is no estimate, and what is wrong with the pose of those who gave one."""
    return "no estimate by " + ", ".join(
        f"{name} (its pose {problems[name]})" if problems.get(name) else name for name in names
    )


def copied(names: Sequence[str], cam_T_obj: Float[ndarray, "k n 4 4"]) -> list[str]:
    """Say for each instance which estimators have one and the same pose, or nothing.

    Two estimators never agree to :data:`COPY_TOLERANCE`: it is one that has two names.

    Parameters
    ----------
    names
        The K estimators.
    cam_T_obj
        Their poses of n instances, (K, n, 4, 4).
    """
    out = [""] * cam_T_obj.shape[1]
    with np.errstate(invalid="ignore", over="ignore"):
        depth = np.sort(cam_T_obj[:, :, 2, 3], axis=0)
        largest = np.abs(cam_T_obj).max(axis=(0, 2, 3))
        if not (depth[1:] - depth[:-1] <= 2 * COPY_TOLERANCE * largest).any():  # nearly always
            return out
    for j in range(1, len(names)):
        for i in range(j):
            for n in np.flatnonzero(_same(cam_T_obj[i], cam_T_obj[j])).tolist():
                out[n] = out[n] or (
                    f"{names[i]} and {names[j]} are given one and the same pose, which always "
                    "agrees"
                )
    return out


def _same(one: Float[ndarray, "n 4 4"], other: Float[ndarray, "n 4 4"]) -> Bool[ndarray, " n"]:
    """Find the instances of which two estimators have the same pose but for rounding."""
    with np.errstate(invalid="ignore", over="ignore"):
        apart = np.abs(one - other)[:, :3]
        distance = np.linalg.norm(one[:, :3, 3], axis=1)
        near = apart[:, :, 3].max(axis=1) <= COPY_TOLERANCE * distance
        return np.asarray(near & (apart[:, :, :3].max(axis=(1, 2)) <= COPY_TOLERANCE))


def refuse_copies(names: Sequence[str], cam_T_obj: Float[ndarray, "k n 4 4"]) -> None:
    """Raise if two estimators have the same pose of every instance.

    Raises
    ------
    InputError
        Naming the two.
    """
    for j in range(1, len(names)):
        for i in range(j):
            if len(cam_T_obj[i]) and _same(cam_T_obj[i], cam_T_obj[j]).all():
                raise InputError(
                    f"{names[j]} has the same pose as {names[i]} in each of "
                    f"{len(cam_T_obj[i])} instances, so they are one estimator, whose agreement "
                    "with itself says nothing; give results of others",
                    parameters=("estimates",),
                )


def refuse_conventions(
    names: Sequence[str],
    cam_T_obj: Float[ndarray, "k n 4 4"],
    obj_id: Int[ndarray, " n"],
    models: Models | None,
) -> None:
    """Raise if an estimator's poses agree with another's only in another convention.

    Parameters
    ----------
    names
        The K estimators.
    cam_T_obj
        Their poses of n instances of one dataset, (K, n, 4, 4).
    obj_id
        The objects, (n,).
    models
        The dataset's models, whose symmetries are no disagreement.

    Raises
    ------
    MismatchError
        Naming the estimator and the convention.
    """
    symmetries = None
    if models is not None:
        alone = np.eye(4)[None]
        of = {
            n: models.info[n].symmetries if n in models.info else alone
            for n in np.unique(obj_id).tolist()
        }
        symmetries = [of[n] for n in obj_id.tolist()]
    if said := find_odd_one(names, cam_T_obj, symmetries):
        raise MismatchError(said, parameters=("estimates",))


def none_in_common(
    dataset: str,
    results: Mapping[str, Results],
    tables: Sequence[Results],
    left_out: Sequence[str],
) -> MismatchError:
    """Return the error that no instance has a pose by every estimator, with the reason."""
    sizes = ", ".join(f"{name}: {len(table)} rows" for name, table in results.items())
    empty = [f"{table.source} holds no estimate" for table in tables if not len(table)]
    why = "; ".join(left_out) or next(iter(empty), "are these files of the same dataset and split?")
    return MismatchError(
        f"no instance of {dataset} has a pose by every estimator ({sizes}); {why}",
        parameters=("estimates",),
    )
