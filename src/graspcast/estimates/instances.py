"""Which object in which image: the key of an instance, one or many, and joins on it.

BOP's words: ``gt_id`` is a true instance's row in ``scene_gt.json``; ``est_id`` is the rank of an
estimate among its estimator's estimates of that object in that image, by decreasing score, from 0
(:func:`graspcast.bop.results.score_order` orders equal scores). ``est_id`` is an estimator's own:
estimate 1 of one estimator need not be of the same true object as estimate 1 of another. Where
several estimators are aligned, it is the principal's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, NamedTuple

import numpy as np
import polars as pl
from jaxtyping import Bool, Int
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.io.wording import counted

__all__ = [
    "KEY_COLUMNS",
    "KEY_SCHEMA",
    "InstanceKey",
    "Instances",
    "UnitKind",
    "object_name",
    "scene_groups",
    "split_object_name",
    "unit_names",
]

UnitKind = Literal["scene", "image"]

KEY_SCHEMA: dict[str, Any] = {
    "dataset": pl.String,
    "scene_id": pl.Int64,
    "im_id": pl.Int64,
    "obj_id": pl.Int64,
    "est_id": pl.Int64,
}
"""The columns of an instance's key in every table, in order, with their types."""

KEY_COLUMNS = tuple(KEY_SCHEMA)
"""Their names."""

_MOST_DIGITS = 19


def object_name(dataset: str, obj_id: int) -> str:
    """Return an object's name, ``dataset-obj_id``, for example ``lmo-5``."""
    return f"{dataset}-{obj_id}"


def split_object_name(name: str) -> tuple[str, int]:
    """Return dataset and obj_id of an object's name.

    Raises
    ------
    InputError
        If the name is not ``dataset-obj_id``, or its number is written otherwise than names are,
        as in ``lmo-05``, so that no object has two names.
    """
    dataset, _, number = name.rpartition("-")
    if not dataset or not number.isdecimal() or len(number) > _MOST_DIGITS:
        shown = repr(name) if len(repr(name)) < 80 else f"{repr(name)[:77]}…"
        raise InputError(f"an object's name is DATASET-NUMBER, for example lmo-5, not {shown}")
    obj_id = int(number)
    if str(obj_id) != number:
        raise InputError(f"an object's name is {dataset}-{obj_id}, not {name!r}")
    return dataset, obj_id


class InstanceKey(NamedTuple):
    """The key of one instance; orders by dataset, scene, image, object and estimate."""

    dataset: str
    scene_id: int
    im_id: int
    obj_id: int
    est_id: int

    @property
    def object(self) -> str:
        """The object's name, ``dataset-obj_id``."""
        return object_name(self.dataset, self.obj_id)

    @property
    def image(self) -> tuple[int, int]:
        """Scene and image."""
        return self.scene_id, self.im_id

    def __str__(self) -> str:
        return f"{self.object} in image {self.scene_id}/{self.im_id}, est_id {self.est_id}"


@dataclass(frozen=True, eq=False, repr=False)
class Instances:
    """The keys of n instances, as columns.

    Attributes
    ----------
    dataset
        Names of datasets, (n,).
    scene_id, im_id, obj_id
        BOP numbers, (n,).
    est_id
        Rank by score among the estimates of the same object in the same image, from 0, (n,).
    """

    dataset: ndarray
    scene_id: Int[ndarray, " n"]
    im_id: Int[ndarray, " n"]
    obj_id: Int[ndarray, " n"]
    est_id: Int[ndarray, " n"]

    @classmethod
    def of(cls, keys: Sequence[InstanceKey]) -> Instances:
        """Return the columns of some keys."""
        columns = zip(*keys, strict=True) if keys else ([] for _ in KEY_COLUMNS)
        dataset, *numbers = columns
        return cls(
            np.array(dataset, dtype=str), *(np.array(column, dtype=np.int64) for column in numbers)
        )

    @classmethod
    def from_frame(cls, frame: pl.DataFrame) -> Instances:
        """Return the keys that a table with :data:`KEY_COLUMNS` has; an unstated est_id is 0."""
        dataset = np.array(frame["dataset"].to_list(), dtype=str)
        numbers = (frame[name].fill_null(0).to_numpy() for name in KEY_COLUMNS[1:])
        return cls(dataset, *numbers)

    @classmethod
    def concatenate(cls, parts: Sequence[Instances]) -> Instances:
        """Return the instances of several, one after the other."""
        return cls(
            *(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(cls))
        )

    def __len__(self) -> int:
        return len(self.obj_id)

    def __repr__(self) -> str:
        images, objects = len(set(unit_names(self, "image"))), len(set(self.objects))
        return (
            f"Instances({len(self)} of {counted(objects, 'object')} in {counted(images, 'image')})"
        )

    @property
    def objects(self) -> ndarray:
        """The name of each instance's object, ``dataset-obj_id``, (n,)."""
        pairs = zip(self.dataset.tolist(), self.obj_id.tolist(), strict=True)
        return np.array([object_name(d, o) for d, o in pairs], dtype=str)

    def to_keys(self) -> list[InstanceKey]:
        """Return the key of each instance."""
        columns = (getattr(self, name).tolist() for name in KEY_COLUMNS)
        return [InstanceKey(*row) for row in zip(*columns, strict=True)]

    def frame(self) -> pl.DataFrame:
        """Return the keys as a table of :data:`KEY_COLUMNS`."""
        columns = {name: getattr(self, name) for name in KEY_COLUMNS}
        return pl.DataFrame(columns | {"dataset": self.dataset.tolist()}, schema=KEY_SCHEMA)

    def select(self, which: Bool[ndarray, " n"] | Int[ndarray, " m"]) -> Instances:
        """Return some of the instances, by mask or by number."""
        return Instances(*(getattr(self, f.name)[which] for f in fields(self)))


def unit_names(instances: Instances, kind: UnitKind) -> ndarray:
    """Return the name of each instance's scene or image.

    Parameters
    ----------
    instances
        Of n instances.
    kind
        ``scene`` names ``dataset/scene_id``, ``image`` names ``dataset/scene_id/im_id``.

    Returns
    -------
        Text, (n,).
    """
    columns = [instances.dataset.tolist(), instances.scene_id.tolist()]
    if kind == "image":
        columns.append(instances.im_id.tolist())
    return np.array(["/".join(map(str, row)) for row in zip(*columns, strict=True)])


def scene_groups(instances: Instances, *, blocks: int = 5) -> ndarray:
    """Return a name for each instance's group of neighbouring frames, for cross-validation.

    A group is a scene. A dataset's only scene is cut into contiguous blocks of frames of about
    equal size, since it could not be split otherwise.

    Parameters
    ----------
    instances
        Of n instances.
    blocks
        Into how many blocks an only scene is cut.

    Returns
    -------
        Text, (n,).
    """
    names = np.array(
        [f"{d}/{s}" for d, s in zip(instances.dataset, instances.scene_id, strict=True)],
        dtype=object,
    )
    for dataset in np.unique(instances.dataset):
        mine = instances.dataset == dataset
        if len(np.unique(names[mine])) > 1:
            continue
        frames = np.unique(instances.im_id[mine])
        block = np.searchsorted(frames, instances.im_id[mine]) * blocks // len(frames)
        names[mine] = [f"{n}#{b}" for n, b in zip(names[mine], block, strict=True)]
    return names.astype(str)
