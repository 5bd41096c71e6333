"""K estimators' poses of the same instances, side by side.

**Which detection is which instance.** One estimator is the anchor (the principal, where there is
one). Its detections of an object in an image, by decreasing score, are instances 0, 1, … of that
object. Every other estimator's detections of that object are assigned to them one to one, with the
smallest total distance between the objects' positions. An instance that some estimator lacks is
dropped and counted. No ground truth is consulted, so the same rule serves at run time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.results import Results
from graspcast.errors import InputError, MismatchError, UnknownNameError

__all__ = [
    "Estimates",
    "IncompleteInstance",
    "align",
    "assign",
    "concatenate",
    "instance_numbers",
    "partners",
    "rows_in_image",
]

_COLUMNS = ("dataset", "scene_id", "im_id", "obj_id", "est_id")


@dataclass(frozen=True)
class IncompleteInstance:
    """An instance of the anchor's that some other estimator lacks."""

    dataset: str
    scene_id: int
    im_id: int
    obj_id: int
    est_id: int
    lacking: tuple[str, ...]


@dataclass(frozen=True)
class Estimates:
    """Poses of n instances by K estimators.

    Attributes
    ----------
    estimators
        Names, in the order of ``cam_T_obj``'s first axis.
    dataset
        The dataset's name for each instance, (n,).
    scene_id, im_id, obj_id, est_id
        BOP numbers, (n,).
    cam_T_obj
        Poses in metres, (K, n, 4, 4).
    lacking
        For each estimator, how many instances it lacks that another one has.
    partial
        The anchor's instances that were dropped, and who lacks them.
    """

    estimators: tuple[str, ...]
    dataset: ndarray
    scene_id: Int[ndarray, "n"]
    im_id: Int[ndarray, "n"]
    obj_id: Int[ndarray, "n"]
    est_id: Int[ndarray, "n"]
    cam_T_obj: Float[ndarray, "k n 4 4"]
    lacking: Mapping[str, int] = field(default_factory=dict)
    partial: tuple[IncompleteInstance, ...] = ()

    def __len__(self) -> int:
        return len(self.obj_id)

    def index(self, estimator: str) -> int:
        """The number of an estimator.

        Raises
        ------
        UnknownNameError
            Listing those there are.
        """
        if estimator not in self.estimators:
            raise UnknownNameError("estimator", estimator, self.estimators)
        return self.estimators.index(estimator)

    def of(self, estimator: str) -> Float[ndarray, "n 4 4"]:
        """The poses by one estimator."""
        return self.cam_T_obj[self.index(estimator)]

    def supporters(self, principal: str) -> tuple[str, ...]:
        """The other estimators, in order."""
        self.index(principal)
        return tuple(name for name in self.estimators if name != principal)

    def only(self, *estimators: str) -> Estimates:
        """The poses by these estimators, in this order.

        Raises
        ------
        UnknownNameError
            For one that is not there.
        """
        if estimators == self.estimators:
            return self
        which = [self.index(name) for name in estimators]
        return replace(self, estimators=estimators, cam_T_obj=self.cam_T_obj[which])

    @property
    def objects(self) -> ndarray:
        """``dataset-number`` of each instance's object, (n,)."""
        names = [f"{d}-{o}" for d, o in zip(self.dataset, self.obj_id, strict=True)]
        return np.array(names, dtype=str)

    def instances(self) -> list[tuple[str, int, int, int, int]]:
        """Dataset, scene, image, object and instance number of each instance."""
        return list(zip(*(getattr(self, name).tolist() for name in _COLUMNS), strict=True))

    def select(self, which: Bool[ndarray, "n"] | Int[ndarray, "m"]) -> Estimates:
        """Some of the instances, by mask or by number."""
        rows = {name: getattr(self, name)[which] for name in _COLUMNS}
        return replace(self, **rows, cam_T_obj=self.cam_T_obj[:, which])


def instance_numbers(results: Results) -> Int[ndarray, "n"]:
    """Each row's rank, by decreasing score, among its object's detections in its image."""
    keys = np.stack([results.scene_id, results.im_id, results.obj_id])
    _, group = np.unique(keys, axis=1, return_inverse=True)
    # Stable, so equal scores stay in the file's order.
    order = np.lexsort((-results.score, group))
    first = np.searchsorted(group[order], group[order], side="left")
    out = np.empty(len(results), dtype=np.int64)
    out[order] = np.arange(len(results)) - first
    return out


def rows_in_image(results: Results, scene_id: int, im_id: int, what: str) -> Int[ndarray, "m"]:
    """An image's rows by instance number, so that of one object's results row N is instance N.

    Parameters
    ----------
    results
        Those of one object, or of several.
    scene_id, im_id
        The image.
    what
        Whose results they are, for the message.

    Raises
    ------
    InputError
        If there are none, listing images that have some.
    """
    rows = np.flatnonzero((results.scene_id == scene_id) & (results.im_id == im_id))
    if not len(rows):
        where = zip(results.scene_id.tolist(), results.im_id.tolist(), strict=True)
        others = [f"{scene}/{image}" for scene, image in sorted(set(where))]
        known = ", ".join([*others[:5], *(["…"] if len(others) > 5 else [])]) or "no image"
        raise InputError(
            f"{results.source}: no estimate of {what} in image {scene_id}/{im_id}; it has one in "
            f"{known}"
        )
    # Stable, so that equal scores stay in the file's order.
    return rows[np.argsort(-results.score[rows], kind="stable")]


def assign(
    anchors: Float[ndarray, "a 3"], others: Float[ndarray, "b 3"]
) -> tuple[Int[ndarray, "m"], Int[ndarray, "m"]]:
    """Pair positions one to one with the smallest total distance; the surplus stays unpaired."""
    if len(anchors) == 1 and len(others) == 1:
        return np.array([0]), np.array([0])
    if len(anchors) == 0 or len(others) == 0:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    from scipy.optimize import linear_sum_assignment

    distance = np.linalg.norm(anchors[:, None] - others[None], axis=-1)
    rows, columns = linear_sum_assignment(distance)
    return rows, columns


def align(results: Mapping[str, Results], *, dataset: str, anchor: str | None = None) -> Estimates:
    """Put K >= 2 estimators' results of one dataset side by side.

    Parameters
    ----------
    results
        Estimator's name to its results.
    dataset
        The dataset's name.
    anchor
        The estimator whose detections number the instances; by default the first.

    Raises
    ------
    InputError
        For fewer than two estimators.
    UnknownNameError
        For an anchor that is none of them.
    MismatchError
        If no instance has a pose by all of them.
    """
    names = tuple(results)
    if len(names) < 2:
        raise InputError(
            f"a consensus takes two estimators or more, but there is {len(names)}: "
            "give --estimates NAME=FILE once for each"
        )
    anchor = anchor or names[0]
    if anchor not in names:
        raise UnknownNameError("estimator", anchor, names)
    first = names.index(anchor)
    stacked = [np.stack([t.scene_id, t.im_id, t.obj_id], axis=1) for t in results.values()]
    keys, inverse = np.unique(np.concatenate(stacked), axis=0, return_inverse=True)
    groups = np.split(inverse, np.cumsum([len(t) for t in results.values()])[:-1])
    counts = np.stack([np.bincount(g, minlength=len(keys)) for g in groups])
    missing = (counts.max(axis=0) - counts).sum(axis=1)
    kept: list[tuple[int, int, list[int]]] = []  # key, instance, one row for each estimator
    partial: list[IncompleteInstance] = []
    rows_of = [_rows_by_group(t, g) for t, g in zip(results.values(), groups, strict=True)]
    for key in np.flatnonzero(counts[first]).tolist():
        rows = [by_key.get(key, []) for by_key in rows_of]
        for i, found in enumerate(partners(rows, first, list(results.values()))):
            if None in found:
                without = tuple(n for n, r in zip(names, found, strict=True) if r is None)
                scene, image, obj_id = keys[key].tolist()
                partial.append(IncompleteInstance(dataset, scene, image, obj_id, i, without))
            else:
                kept.append((key, i, [r for r in found if r is not None]))
    if not kept:
        sizes = ", ".join(f"{name}: {len(table)} rows" for name, table in results.items())
        raise MismatchError(
            f"no instance of {dataset} has a pose by every estimator ({sizes}); are these files "
            "of the same dataset and split?"
        )
    keys = keys[[key for key, _, _ in kept]]
    picked = np.array([rows for _, _, rows in kept], dtype=np.int64).T
    return Estimates(
        estimators=names,
        dataset=np.full(len(kept), dataset),
        scene_id=keys[:, 0],
        im_id=keys[:, 1],
        obj_id=keys[:, 2],
        est_id=np.array([i for _, i, _ in kept], dtype=np.int64),
        cam_T_obj=np.stack([results[n].cam_T_obj[p] for n, p in zip(names, picked, strict=True)]),
        lacking=dict(zip(names, missing.tolist(), strict=True)),
        partial=tuple(partial),
    )


def _rows_by_group(results: Results, group: ndarray) -> dict[int, list[int]]:
    """The rows of each group, by decreasing score; ties in the file's order."""
    out: dict[int, list[int]] = {}
    order = np.argsort(-results.score, kind="stable")
    for row, key in zip(order.tolist(), group[order].tolist(), strict=True):
        out.setdefault(key, []).append(row)
    return out


def partners(
    rows: list[list[int]], anchor: int, results: list[Results]
) -> Iterator[list[int | None]]:
    """For each of the anchor's rows the one of every estimator, or None.

    Parameters
    ----------
    rows
        For each estimator, its rows of one object in one image, by decreasing score.
    anchor
        The number of the estimator whose detections number the instances.
    results
        Each estimator's results.
    """
    if all(len(found) <= 1 for found in rows):  # nearly always
        yield [found[0] if found else None for found in rows]
        return
    position = [table.cam_T_obj[r, :3, 3] for table, r in zip(results, rows, strict=True)]
    partner: list[dict[int, int]] = []
    for k, found in enumerate(rows):
        n = range(len(found))
        a, b = (n, n) if k == anchor else assign(position[anchor], position[k])
        partner.append({int(i): found[int(j)] for i, j in zip(a, b, strict=True)})
    for i in range(len(rows[anchor])):
        yield [found.get(i) for found in partner]


def concatenate(parts: Iterable[Estimates]) -> Estimates:
    """Estimates of several datasets, one after the other.

    Raises
    ------
    MismatchError
        If the estimators differ.
    """
    parts = list(parts)
    names = parts[0].estimators
    for part in parts[1:]:
        if part.estimators != names:
            raise MismatchError(
                f"{parts[0].dataset[0]} has estimates by {', '.join(names)}, but "
                f"{part.dataset[0]} by {', '.join(part.estimators)}; each needs the same ones"
            )
    return Estimates(
        estimators=names,
        **{name: np.concatenate([getattr(p, name) for p in parts]) for name in _COLUMNS},
        cam_T_obj=np.concatenate([p.cam_T_obj for p in parts], axis=1),
        lacking={name: sum(p.lacking.get(name, 0) for p in parts) for name in names},
        partial=tuple(instance for p in parts for instance in p.partial),
    )
