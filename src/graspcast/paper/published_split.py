"""TODO."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import polars as pl
from numpy import ndarray

from graspcast.errors import FormatError
from graspcast.forecasting.samples import Samples, _keys

__all__ = ["published_part", "read_split"]


def read_split(path: str | PathLike[str]) -> pl.DataFrame:
    """Read ``split.csv``: principal, gripper, dataset, scene_id, im_id, obj_id, split.

    Raises
    ------
    FormatError
        If a column is missing, or ``split`` holds more than train and test.
    """
    columns = ("principal", "gripper", "dataset", "scene_id", "im_id", "obj_id", "split")
    try:
        frame = pl.read_csv(Path(path))
    except (OSError, pl.exceptions.PolarsError) as error:
        raise FormatError(path, f"cannot be read ({str(error).splitlines()[0]})") from error
    missing = [name for name in columns if name not in frame.columns]
    if missing:
        raise FormatError(path, f"no column {', '.join(missing)}; found {frame.columns}")
    if odd := set(frame["split"].unique()) - {"train", "test"}:
        raise FormatError(path, f"split should be train or test, but holds {odd}")
    return frame.select(columns)


def published_part(samples: Samples, split: pl.DataFrame) -> ndarray:
    """``train``, ``test`` or an empty string for each sample, by its principal and gripper."""
    mine = split.filter(
        pl.col("principal") == samples.principal, pl.col("gripper") == samples.gripper
    )
    keys = _keys(samples.estimates)
    on = ["dataset", "scene_id", "im_id", "obj_id"]
    part = keys.join(mine.select(*on, "split"), on=on, how="left", maintain_order="left")["split"]
    return part.fill_null("").to_numpy().astype(str)
