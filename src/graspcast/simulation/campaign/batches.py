"""Batches of a campaign: the trials that are left, in parts that are made as they are needed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import overload

import numpy as np
import polars as pl
from jaxtyping import Int
from numpy import ndarray

from graspcast.simulation.campaign.jobs import Batch
from graspcast.simulation.campaign.requests import SetupKey, TrialRequests

__all__ = ["Batches", "batch_size"]

_SMALLEST, _LARGEST = 16, 256
_TRIALS_OF_ONE_MORE = 10_000


def batch_size(trials: int) -> int:
    """Return how many trials a batch has: 16, more of a million trials and 256 of ten million.

    A batch is sent, and stored in a file, as a whole: many small ones would keep the process that
    does so busier than the workers.

    Parameters
    ----------
    trials
        The trials that are left.
    """
    return min(max(trials // _TRIALS_OF_ONE_MORE, _SMALLEST), _LARGEST)


class Batches(Sequence[Batch]):
    """Trials of one setup after another, in batches.

    Parameters
    ----------
    requests
        All trials of the campaign.
    left
        Row numbers of those to run.
    """

    def __init__(self, requests: TrialRequests, left: Int[ndarray, " m"]):
        self._requests = requests
        grouped = (
            requests.keys.select("object", "gripper", "grasp")[left]
            .with_columns(row=pl.Series(left, dtype=pl.Int64))
            .group_by("object", "gripper", "grasp", maintain_order=True)
            .agg("row")
        )
        size = batch_size(len(left))
        self._rows: list[np.ndarray] = [rows.to_numpy() for rows in grouped["row"]]
        self._setups: list[SetupKey] = list(
            grouped.select("object", "gripper", "grasp").iter_rows()
        )
        counts = [-(-len(rows) // size) for rows in self._rows]
        self._first = np.cumsum([0, *counts])
        self._size = size

    def __len__(self) -> int:
        return int(self._first[-1])

    @overload
    def __getitem__(self, index: int) -> Batch: ...
    @overload
    def __getitem__(self, index: slice) -> list[Batch]: ...

    def __getitem__(self, index: int | slice) -> Batch | list[Batch]:
        """Return a batch, or several."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"there are {len(self)} batches, none is number {index}")
        number = index % len(self)
        k = int(np.searchsorted(self._first, number, side="right")) - 1
        start = (number - int(self._first[k])) * self._size
        rows = self._rows[k][start : start + self._size]
        return Batch(self._setups[k], rows, self._requests.obj_T_est[rows])
