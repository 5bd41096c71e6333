"""The objects that a network was trained for: sizes, and whether a dataset's are the same."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.errors import MismatchError
from graspcast.pose.lengths import shown

__all__ = ["TrainedObject", "TrainedObjects"]

_DIAMETER_SHARE = 0.01
"""Largest difference of diameters, as a share of the trained one."""
_BOX_SHARE = 0.02
"""Largest difference of the bounding boxes' corners, as a share of the diameter."""


@dataclass(frozen=True, eq=False)
class TrainedObject:
    """Geometry of an object that a network was trained for; metres, object frame.

    Attributes
    ----------
    obj_id
        Its BOP id.
    diameter_m
        The largest distance between two points.
    lower, size
        Minimum corner and side lengths of its bounding box.
    keypoints
        Points on its surface, (k, 3).
    """

    obj_id: int
    diameter_m: float
    lower: Float[ndarray, " 3"]
    size: Float[ndarray, " 3"]
    keypoints: Float[ndarray, "k 3"]

    @classmethod
    def from_metadata(cls, entry: Mapping[str, Any]) -> TrainedObject:
        """Read an object's entry in the metadata of a network.

        Raises
        ------
        KeyError, TypeError, ValueError
            If an entry is missing or wrong.
        """
        return cls(
            int(entry["obj_id"]),
            float(entry["diameter_m"]),
            np.array(entry["lower"], dtype=np.float64).reshape(3),
            np.array(entry["size"], dtype=np.float64).reshape(3),
            np.array(entry["keypoints"], dtype=np.float64).reshape(-1, 3),
        )


@dataclass(frozen=True, eq=False)
class TrainedObjects:
    """All objects of a network, and the dataset whose they are.

    Attributes
    ----------
    source
        The file of the network, for messages.
    dataset
        Name of the dataset; None if the file does not say.
    by_id
        The objects by BOP id, in the order of training.
    """

    source: str
    dataset: str | None
    by_id: Mapping[int, TrainedObject] = field(default_factory=dict)

    def check(self, dataset: BopDataset, obj_ids: Collection[int]) -> None:
        """Raise if an object of a dataset is another one than that of the same number here.

        Parameters
        ----------
        dataset
            The dataset in which objects are to be found.
        obj_ids
            The numbers of these objects; those that the network does not know are left out.

        Raises
        ------
        MismatchError
            If an object has another diameter (by more than 1 %) or another frame (its box is
            displaced by more than 2 % of the diameter).
        """
        known = [obj_id for obj_id in self.by_id if obj_id in set(obj_ids)]
        for obj_id in known:
            mine, info = self.by_id[obj_id], dataset.models[obj_id]
            problem = ""
            apart = abs(mine.diameter_m - info.diameter_m)
            corners = np.stack([mine.lower, mine.lower + mine.size])
            moved = np.abs(corners - np.stack([info.lower, info.lower + info.size])).max()
            if apart > _DIAMETER_SHARE * mine.diameter_m:
                problem = "they differ in diameter, so the object is another one"
            elif moved > _BOX_SHARE * mine.diameter_m:
                problem = (
                    f"they differ in frame: the bounding boxes are {shown(float(moved))} apart, "
                    "and poses would be in the frame of training"
                )
            if problem:
                here = f"{self.dataset or 'object'}{'-' if self.dataset else ' '}{obj_id}"
                raise MismatchError(
                    f"{self.source} was trained for {here} ({shown(mine.diameter_m)} across), but "
                    f"object {obj_id} of {dataset.root} is {dataset.name}-{obj_id} "
                    f"({shown(info.diameter_m)} across): {problem}. Otherwise train weights for "
                    f"{dataset.name}",
                    parameters=("bop", "weights"),
                )
