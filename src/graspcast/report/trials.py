"""Trials of a run: outcomes with their reasons, errors, and the campaign they are from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import polars as pl

from graspcast.estimates.outcomes import (
    ERROR_COLUMNS,
    TRIAL_COLUMNS,
    checked_outcomes,
    read_outcomes,
)
from graspcast.io.tables import read_csv, read_parquet
from graspcast.simulation.campaign.store import Store

__all__ = ["DETAILS", "Trials", "read_trials"]

DETAILS: dict[str, Any] = {
    "outcome": pl.String,
    "offset_m": pl.Float64,
    "short_m": pl.Float64,
    "force_n": pl.Float64,
    "hit": pl.String,
    **dict.fromkeys(ERROR_COLUMNS, pl.Float64),
}
"""What a trial may say beside its success; null where it does not. ``outcome`` is the reason."""


@dataclass(frozen=True, eq=False)
class Trials:
    """The trials of one file or campaign.

    Attributes
    ----------
    path
        Where they are from.
    table
        :data:`~graspcast.estimates.outcomes.TRIAL_COLUMNS`, ``success`` (0 or 1) and
        :data:`DETAILS`; ``est_id`` is null where it is not stated.
    manifest
        The campaign's; empty for a table of another origin.
    """

    path: Path
    table: pl.DataFrame
    manifest: Mapping[str, Any] = field(default_factory=dict)

    @property
    def estimators(self) -> list[str]:
        """Whose estimates guided the trials."""
        return sorted(self.table["estimator"].unique().to_list())

    @property
    def sources(self) -> dict[str, str]:
        """Estimators to the names of the results files that guided trials, where stated."""
        named = self.manifest.get("sources", {})
        pairs = named.items() if isinstance(named, Mapping) else ()
        return {what.rpartition(" on ")[0]: Path(str(text)).name for what, text in pairs}

    @property
    def protocol(self) -> str:
        """The protocol of the trials; empty if it is not stated."""
        setups = self.manifest.get("setups", ())
        told = {str(s.get("protocol", "paper")) for s in setups if isinstance(s, Mapping)}
        return ", ".join(sorted(told))


def read_trials(path: Path) -> Trials:
    """Read trials from a campaign's directory, or from a table of outcomes.

    Raises
    ------
    FormatError
        Naming the file, the column or row, and the remedy.
    """
    if (path / "manifest.json").is_file():
        store = Store(path)
        manifest, raw = store.manifest, store.outcomes()
        return Trials(path, _with_details(checked_outcomes(raw, source=path), raw), manifest)
    table = read_outcomes(path)
    if path.is_dir():
        return Trials(path, _with_details(table, None))
    raw = read_parquet(path) if path.suffix == ".parquet" else read_csv(path)
    return Trials(path, _with_details(table, raw))


def _with_details(table: pl.DataFrame, raw: pl.DataFrame | None) -> pl.DataFrame:
    """Return checked outcomes with what else the same rows of the file say."""
    table = table.select(*TRIAL_COLUMNS, "success")
    details = {"outcome": "reason"} | {name: name for name in DETAILS if name != "outcome"}
    columns = []
    for name, kind in DETAILS.items():
        if raw is not None and details[name] in raw.columns:
            found = raw[details[name]].cast(kind, strict=False).alias(name)
            columns.append(found.fill_nan(None) if kind == pl.Float64 else found)
        else:
            columns.append(pl.Series(name, [None] * len(table), dtype=kind))
    return table.with_columns(columns)
