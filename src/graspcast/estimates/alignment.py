"""Alignment of K estimators' poses: the same instances, side by side.

**Which estimate is of which instance.** One estimator is the anchor (the principal, where there is
one). Its estimates of an object in an image, by decreasing score, are the instances of that object:
their ``est_id`` is 0, 1, … Every other estimator's estimates of that object are assigned to them
one to one, with the smallest total distance between positions (the Hungarian method). An instance
for which some estimator has no estimate is incomplete: it is set aside and counted. No ground truth
is used, so the same rule serves in training and at run time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.bop.results import Results, score_order
from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.checks import (
    IncompleteInstance,
    check_shapes,
    none_in_common,
    refuse_conventions,
    refuse_copies,
    sane_rows,
)
from graspcast.estimates.instances import InstanceKey, Instances
from graspcast.io.arguments import NAME, a, checked, mapping

__all__ = [
    "Estimates",
    "IncompleteInstance",
    "align",
    "assign",
    "concatenate",
    "estimate_ids",
    "partners",
    "rows_in_image",
]


@dataclass(frozen=True, eq=False, repr=False)
class Estimates:
    """Poses of n instances by K estimators.

    Attributes
    ----------
    estimators
        Names, in the order of ``cam_T_obj``'s first axis.
    instances
        The keys of the instances.
    cam_T_obj
        Poses in metres, (K, n, 4, 4).
    lacking
        For each estimator, the number of instances that it lacks and another one has.
    incomplete
        The anchor's instances that were set aside, and the estimators that lack them.
    alone
        Whether no estimator has another estimate of the object in the image, (n,), None if unknown.
    tied
        Whether the anchor has another estimate of the object in the image with the same score,
        (n,), None if unknown.
    refused
        Which poses were left out since they cannot be, in words.
    seen
        What else is known of the estimates, by name: ``score``, and numbers of image fit
        (:mod:`graspcast.rendering.image_fit`), NaN where unknown, each (K, n).
    """

    estimators: tuple[str, ...]
    instances: Instances
    cam_T_obj: Float[ndarray, "k n 4 4"]
    lacking: Mapping[str, int] = field(default_factory=dict)
    incomplete: tuple[IncompleteInstance, ...] = ()
    alone: Bool[ndarray, " n"] | None = None
    tied: Bool[ndarray, " n"] | None = None
    refused: tuple[str, ...] = ()
    seen: Mapping[str, Float[ndarray, "k n"]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_shapes(self.estimators, self.instances, self.cam_T_obj)

    def __len__(self) -> int:
        return len(self.instances)

    def __repr__(self) -> str:
        return f"Estimates({', '.join(self.estimators)}; {self.instances!r})"

    @property
    def objects(self) -> ndarray:
        """The name of each instance's object, ``dataset-obj_id``, (n,)."""
        return self.instances.objects

    @property
    def dataset(self) -> ndarray:
        """``dataset`` of each instance, (n,)."""
        return self.instances.dataset

    @property
    def scene_id(self) -> ndarray:
        """``scene_id`` of each instance, (n,)."""
        return self.instances.scene_id

    @property
    def im_id(self) -> ndarray:
        """``im_id`` of each instance, (n,)."""
        return self.instances.im_id

    @property
    def obj_id(self) -> ndarray:
        """``obj_id`` of each instance, (n,)."""
        return self.instances.obj_id

    @property
    def est_id(self) -> ndarray:
        """``est_id`` of each instance, (n,)."""
        return self.instances.est_id

    def index(self, estimator: str) -> int:
        """Return the number of an estimator.

        Raises
        ------
        UnknownNameError
            Listing those there are.
        """
        if estimator not in self.estimators:
            raise UnknownNameError("estimator", estimator, self.estimators)
        return self.estimators.index(estimator)

    def of(self, estimator: str) -> Float[ndarray, "n 4 4"]:
        """Return the poses by one estimator."""
        return self.cam_T_obj[self.index(estimator)]

    def supporters(self, principal: str) -> tuple[str, ...]:
        """Return the other estimators, in order."""
        self.index(principal)
        return tuple(name for name in self.estimators if name != principal)

    def only(self, *estimators: str) -> Estimates:
        """Return the poses by these estimators, in this order.

        Raises
        ------
        UnknownNameError
            For one that is not there.
        """
        if estimators == self.estimators:
            return self
        which = [self.index(name) for name in estimators]
        seen = {name: values[which] for name, values in self.seen.items()}
        return replace(self, estimators=estimators, cam_T_obj=self.cam_T_obj[which], seen=seen)

    def select(self, which: Bool[ndarray, " n"] | Int[ndarray, " m"]) -> Estimates:
        """Return some of the instances, by mask or by number."""
        return replace(
            self,
            instances=self.instances.select(which),
            cam_T_obj=self.cam_T_obj[:, which],
            alone=None if self.alone is None else self.alone[which],
            tied=None if self.tied is None else self.tied[which],
            seen={name: values[:, which] for name, values in self.seen.items()},
        )


def estimate_ids(results: Results) -> Int[ndarray, " n"]:
    """Return each row's ``est_id``: its rank among the rows of its object in its image."""
    if len(results) < 2:  # as often at run time
        return np.zeros(len(results), dtype=np.int64)
    keys = np.stack([results.scene_id, results.im_id, results.obj_id])
    _, group = np.unique(keys, axis=1, return_inverse=True)
    order = score_order(results)
    order = order[np.argsort(group[order], kind="stable")]
    first = np.searchsorted(group[order], group[order], side="left")
    out = np.empty(len(results), dtype=np.int64)
    out[order] = np.arange(len(results)) - first
    return out


def rows_in_image(results: Results, scene_id: int, im_id: int, what: str) -> Int[ndarray, " m"]:
    """Return an image's rows by decreasing score: of one object, row N is the one of ``est_id`` N.

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
    order = score_order(results)
    rows = order[(results.scene_id[order] == scene_id) & (results.im_id[order] == im_id)]
    if not len(rows):
        where = zip(results.scene_id.tolist(), results.im_id.tolist(), strict=True)
        others = [f"{scene}/{image}" for scene, image in sorted(set(where))]
        known = ", ".join([*others[:5], *(["…"] if len(others) > 5 else [])]) or "no image"
        raise InputError(
            f"{results.source}: no estimate of {what} in image {scene_id}/{im_id}; it has one in "
            f"{known}",
            parameters=("image",),
        )
    return rows


def assign(
    anchors: Float[ndarray, "a 3"], others: Float[ndarray, "b 3"]
) -> tuple[Int[ndarray, " m"], Int[ndarray, " m"]]:
    """Pair positions one to one with the smallest total distance; the surplus stays unpaired."""
    if len(anchors) == 1 and len(others) == 1:
        return np.array([0]), np.array([0])
    if len(anchors) == 0 or len(others) == 0:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    from scipy.optimize import linear_sum_assignment

    distance = np.linalg.norm(anchors[:, None] - others[None], axis=-1)
    rows, columns = linear_sum_assignment(distance)
    return rows, columns


@checked(
    results=mapping(a(Results), "estimator"),
    dataset=NAME,
    anchor=NAME,
    models=mapping(a(Models), "dataset"),
)
def align(
    results: Mapping[str, Results],
    *,
    dataset: str,
    anchor: str | None = None,
    required: bool = True,
    models: Mapping[str, Models] | None = None,
) -> Estimates:
    """Align K >= 1 estimators' results of one dataset.

    A pose that cannot be (:mod:`graspcast.pose.sanity`) is no estimate; :attr:`Estimates.refused`
    counts them.

    Parameters
    ----------
    results
        Estimator's name to its results.
    dataset
        The dataset's name.
    anchor
        The estimator whose estimates are the instances; by default the first.
    required
        Whether it is an error that nothing can be compared: no instance has a pose by all of
        them, two have the same poses throughout, or one's are in another convention.
    models
        Dataset's name to its object models; with them, distances are held against diameters.

    Raises
    ------
    InputError
        For no estimator; for what is not results; and, if required, for two names of
        one estimator.
    UnknownNameError
        For an anchor that is none of them.
    MismatchError
        If required: if no instance has a pose by all of them, or the poses of one agree with
        another's only in another convention (:mod:`graspcast.pose.conventions`).
    """
    names = tuple(results)
    if not names:
        raise InputError("there are no estimators to align", parameters=("estimates",))
    anchor = anchor or names[0]
    if anchor not in names:
        raise UnknownNameError("estimator", anchor, names)
    first = names.index(anchor)
    tables, bad, left_out = sane_rows(results, dataset, models)
    stacked = [np.stack([t.scene_id, t.im_id, t.obj_id], axis=1) for t in tables]
    keys, inverse = np.unique(np.concatenate(stacked), axis=0, return_inverse=True)
    groups = np.split(inverse, np.cumsum([len(t) for t in tables])[:-1])
    counts = np.stack([np.bincount(g, minlength=len(keys)) for g in groups])
    missing = (counts.max(axis=0) - counts).sum(axis=1)
    kept: list[tuple[InstanceKey, list[int]]] = []  # one row for each estimator
    alone: list[bool] = []
    tied: list[bool] = []
    incomplete: list[IncompleteInstance] = []
    rows_of = [_rows_by_group(t, g) for t, g in zip(tables, groups, strict=True)]
    for group in np.flatnonzero(counts[first]).tolist():
        rows = [by_group.get(group, []) for by_group in rows_of]
        scores = tables[first].score[rows[first]].tolist()
        for est_id, found in enumerate(partners(rows, first, tables)):
            scene_id, im_id, obj_id = keys[group].tolist()
            key = InstanceKey(dataset, scene_id, im_id, obj_id, est_id)
            if None in found:
                without = tuple(n for n, r in zip(names, found, strict=True) if r is None)
                pose = tables[first].cam_T_obj[found[first]]
                where = (scene_id, im_id, obj_id)
                wrong = {n: b[where] for n, b in zip(names, bad, strict=True) if where in b}
                incomplete.append(IncompleteInstance(key, without, pose, wrong))
            else:
                kept.append((key, [r for r in found if r is not None]))
                alone.append(all(len(mine) == 1 for mine in rows))
                tied.append(scores.count(scores[est_id]) > 1)
    if not kept and required:
        raise none_in_common(dataset, results, tables, left_out)
    picked = np.array([rows for _, rows in kept], dtype=np.int64).reshape(-1, len(names)).T
    out = Estimates(
        estimators=names,
        instances=Instances.of([key for key, _ in kept]),
        cam_T_obj=np.stack([t.cam_T_obj[p] for t, p in zip(tables, picked, strict=True)]),
        lacking=dict(zip(names, missing.tolist(), strict=True)),
        incomplete=tuple(incomplete),
        alone=np.array(alone, dtype=bool),
        tied=np.array(tied, dtype=bool),
        refused=left_out,
        seen={"score": np.stack([t.score[p] for t, p in zip(tables, picked, strict=True)])},
    )
    if required:
        refuse_copies(names, out.cam_T_obj)
        refuse_conventions(names, out.cam_T_obj, out.obj_id, (models or {}).get(dataset))
    return out


def _rows_by_group(results: Results, group: ndarray) -> dict[int, list[int]]:
    """Return the rows of each group, by decreasing score."""
    out: dict[int, list[int]] = {}
    order = score_order(results)
    for row, key in zip(order.tolist(), group[order].tolist(), strict=True):
        out.setdefault(key, []).append(row)
    return out


def partners(
    rows: list[list[int]], anchor: int, results: list[Results]
) -> Iterator[list[int | None]]:
    """Yield, for each of the anchor's rows, the row of every estimator, or None.

    Parameters
    ----------
    rows
        For each estimator, its rows of one object in one image, by decreasing score.
    anchor
        The number of the estimator whose estimates are the instances.
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
    """Return the estimates of several datasets, one after the other.

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
                f"{parts[0].instances.dataset[0]} has estimates by {', '.join(names)}, but "
                f"{part.instances.dataset[0]} by {', '.join(part.estimators)}; each needs the same "
                "ones"
            )
    return Estimates(
        estimators=names,
        instances=Instances.concatenate([part.instances for part in parts]),
        cam_T_obj=np.concatenate([p.cam_T_obj for p in parts], axis=1),
        lacking={name: sum(p.lacking.get(name, 0) for p in parts) for name in names},
        incomplete=tuple(instance for p in parts for instance in p.incomplete),
        alone=_joined_flags([p.alone for p in parts]),
        tied=_joined_flags([p.tied for p in parts]),
        refused=tuple(text for p in parts for text in p.refused),
        seen={
            name: np.concatenate([p.seen[name] for p in parts], axis=1)
            for name in parts[0].seen
            if all(name in p.seen for p in parts)
        },
    )


def _joined_flags(parts: list[ndarray | None]) -> ndarray | None:
    known = [part for part in parts if part is not None]
    return np.concatenate(known) if len(known) == len(parts) else None
