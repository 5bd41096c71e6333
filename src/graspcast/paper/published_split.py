"""The train-test split that the paper's authors published."""

from __future__ import annotations

from os import PathLike

import numpy as np
import polars as pl
from numpy import ndarray

from graspcast.errors import FormatError
from graspcast.estimates.alignment import Estimates
from graspcast.io.tables import read_csv

__all__ = ["published_part", "read_split"]


def read_split(path: str | PathLike[str]) -> pl.DataFrame:
    """Read ``split.csv``: principal, gripper, dataset, scene_id, im_id, obj_id, split.

    Raises
    ------
    FormatError
        If a column is missing, or ``split`` holds more than train and test.
    """
    columns = ("principal", "gripper", "dataset", "scene_id", "im_id", "obj_id", "split")
    frame = read_csv(path)
    missing = [name for name in columns if name not in frame.columns]
    if missing:
        raise FormatError(path, f"no column {', '.join(missing)}; found {frame.columns}")
    if odd := set(frame["split"].unique()) - {"train", "test"}:
        raise FormatError(path, f"split should be train or test, but holds {odd}")
    return frame.select(columns)


def published_part(
    estimates: Estimates, principal: str, gripper: str, split: pl.DataFrame
) -> ndarray:
    """Look up each instance in the split of a principal and gripper.

    Returns
    -------
        ``train``, ``test`` or, for an instance that the split does not have, an empty string, (n,).
    """
    mine = split.filter(pl.col("principal") == principal, pl.col("gripper") == gripper)
    rows = mine.select("dataset", "scene_id", "im_id", "obj_id", "split").rows()
    part = {row[:4]: row[4] for row in rows}
    return np.array([part.get(key[:4], "") for key in estimates.instances.to_keys()], dtype=str)
