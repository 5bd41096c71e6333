"""Export of the attempt log: a table with its matrices as numbers."""

from __future__ import annotations

import numpy as np
import polars as pl

__all__ = ["exported"]


def exported(table: pl.DataFrame, *, nested: bool) -> pl.DataFrame:
    """Return a table whose stored matrices are numbers, row by row.

    Parameters
    ----------
    table
        As :meth:`~graspcast.attempt_log.log.AttemptLog.table` returns it.
    nested
        Lists of numbers (Parquet), or text with spaces between them and times as ISO 8601 (CSV).
    """
    out = []
    for name, kind in table.schema.items():
        column = table[name]
        if kind == pl.Binary:
            values = [None if blob is None else np.frombuffer(blob, "<f8") for blob in column]
            lists = [None if each is None else each.tolist() for each in values]
            column = pl.Series(name, lists, dtype=pl.List(pl.Float64))
            if not nested:
                words = [None if each is None else " ".join(map(repr, each)) for each in lists]
                column = pl.Series(name, words, dtype=pl.String)
        elif isinstance(kind, pl.Datetime) and not nested:
            column = column.dt.strftime("%Y-%m-%dT%H:%M:%S%.6fZ")
        out.append(column)
    return pl.DataFrame(out)
