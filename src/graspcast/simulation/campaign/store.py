"""Store of a campaign: a directory with a manifest and the outcomes.

::

    DIR/manifest.json      configuration, versions, and the hash of the configuration
    DIR/shards/*.parquet   outcomes while the campaign runs; a file is never changed
    DIR/outcomes.parquet   all outcomes, sorted, once complete; replaces the shards
    DIR/README.md          the dataset card

Writes are atomic, so a process killed at any time leaves complete shards. Shards are merged by
writing the merged file first and removing its parts afterwards; outcomes that are stored twice in
between are read once. Many small shards are merged into one of the next level, many of those into
one of the level after: an outcome is written about three times, however many there are.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

import polars as pl

from graspcast.errors import FormatError, InputError, MismatchError
from graspcast.estimates.outcomes import ERROR_COLUMNS, TRIAL_COLUMNS, TRIAL_SCHEMA
from graspcast.io.artefacts import read_artefact, write_artefact
from graspcast.io.files import sweep
from graspcast.io.locks import exclusive_lock
from graspcast.io.tables import read_parquet, write_table

__all__ = ["COLUMNS", "Store"]

COLUMNS = {
    **TRIAL_SCHEMA,
    **dict.fromkeys(ERROR_COLUMNS, pl.Float64),
    "success": pl.Boolean,
    "reason": pl.String,
    "offset_m": pl.Float64,
    "short_m": pl.Float64,
    "force_n": pl.Float64,
    "hit": pl.String,
    "simulated_s": pl.Float64,
    "computed_s": pl.Float64,
    "steps": pl.Int64,
    "object": pl.String,
    "settings": pl.String,
    "mujoco": pl.String,
}
"""The columns of a campaign's outcomes, in order."""

_ADDED: dict[str, float | None] = {"short_m": float("nan"), "force_n": float("nan"), "hit": None}
"""Columns that outcomes of earlier versions lack, and their values by the paper's protocol."""

MANIFEST, SHARDS, OUTCOMES = "manifest.json", "shards", "outcomes.parquet"
_MOST_SHARDS, _HIGHEST_LEVEL = 500, 2


class Store:
    """The directory of a campaign; see the module's docstring.

    Parameters
    ----------
    directory
        Path; created by :meth:`begin`.
    """

    def __init__(self, directory: str | PathLike[str]):
        self.directory = Path(directory)
        self._levels: dict[int, list[Path]] = {}

    @property
    def manifest(self) -> dict[str, Any]:
        """The content of ``manifest.json``.

        Raises
        ------
        FormatError
            If it is missing or damaged.
        """
        path = self.directory / MANIFEST
        if not path.exists():
            raise FormatError(path, "is missing, so this is not a campaign's directory")
        remedy = (
            f"restore it, or choose a new directory (the outcomes in {self.directory} can be read)"
        )
        manifest = read_artefact(path, remedy, parameters=("out",))
        if not isinstance(manifest.get("configuration"), dict):
            raise FormatError(path, "has no configuration, so it is no campaign's manifest")
        return manifest

    def begin(self, manifest: Mapping[str, Any]) -> None:
        """Start a campaign in the directory, or resume it.

        Raises
        ------
        MismatchError
            If the directory holds a campaign of another configuration. The message names the
            differences; nothing is changed.
        InputError
            If the directory holds other files, or cannot be written.
        """
        if (self.directory / MANIFEST).exists():
            self._check_same(manifest)
        else:
            if self.directory.is_dir() and any(self.directory.glob("[!.]*")):
                raise InputError(
                    f"{self.directory} holds files but no campaign; choose a new directory",
                    parameters=("out",),
                )
            write_artefact(self.directory / MANIFEST, manifest, indent=1)
        self._tidy()

    def _check_same(self, manifest: Mapping[str, Any]) -> None:
        # By the paper's protocol, which was the only one once, a configuration does not name it.
        unnamed = {"protocol": "paper"}
        mine, other = (unnamed | m["configuration"] for m in (self.manifest, manifest))
        changed = [k for k in {**mine, **other} if mine.get(k) != other.get(k)]
        if changed:
            differences = ", ".join(
                f"{k} ({_short(mine.get(k))} there, {_short(other.get(k))} now)"
                for k in changed[:5]
            )
            more = f" and {len(changed) - 5} more" if len(changed) > 5 else ""
            raise MismatchError(
                f"{self.directory} holds a campaign of another configuration: "
                f"{differences}{more}; their outcomes cannot be mixed, so choose another directory",
                parameters=("out",),
            )

    def _tidy(self) -> None:
        """Remove incomplete files of a killed process."""
        for directory in (self.directory, self.directory / SHARDS):
            sweep(directory)
        self._levels = {}
        for path in self._shard_files():
            self._levels.setdefault(_level(path), []).append(path)

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Lock the directory; the lock is released when the process ends, however it ends.

        Raises
        ------
        InputError
            If another process holds it.
        """
        busy = f"another process is running the campaign in {self.directory}; wait for it to end"
        with exclusive_lock(self.directory / ".lock", busy):
            yield

    def append(self, outcomes: pl.DataFrame) -> None:
        """Store outcomes in a new shard.

        Raises
        ------
        InputError
            If they cannot be written, for example because the disk is full.
        """
        self._add(outcomes, 0)
        for level in range(_HIGHEST_LEVEL):
            if len(parts := self._levels.get(level, [])) <= _MOST_SHARDS:
                return
            self._add(_together(parts), level + 1)
            for path in parts:
                path.unlink(missing_ok=True)
            parts.clear()

    def _add(self, outcomes: pl.DataFrame, level: int) -> None:
        """Write a shard; its name begins with its level."""
        path = self.directory / SHARDS / f"{level}-{uuid.uuid4().hex}.parquet"
        self._write(path, outcomes)
        self._levels.setdefault(level, []).append(path)

    def finish(self) -> pl.DataFrame:
        """Merge all outcomes into ``outcomes.parquet``, and return them."""
        target, parts = self.directory / OUTCOMES, self._files()
        outcomes = self.outcomes()
        if parts != [target]:
            self._write(target, outcomes)
        for path in parts:
            if path != target:
                path.unlink(missing_ok=True)
        if (self.directory / SHARDS).is_dir() and not any((self.directory / SHARDS).iterdir()):
            (self.directory / SHARDS).rmdir()
        return outcomes

    def outcomes(self) -> pl.DataFrame:
        """Return the outcomes stored so far, sorted by keys, without duplicates.

        Raises
        ------
        FormatError
            If the directory is no campaign's, or one of its files is damaged.
        """
        self.manifest  # noqa: B018 - raises for a directory without a campaign
        return _together(self._files())

    def _files(self) -> list[Path]:
        complete = self.directory / OUTCOMES
        return [*([complete] if complete.exists() else []), *sorted(self._shard_files())]

    def _shard_files(self) -> list[Path]:
        return list((self.directory / SHARDS).glob("[!.]*.parquet"))

    def _write(self, path: Path, outcomes: pl.DataFrame) -> None:
        kept = outcomes.select(pl.col(name).cast(kind) for name, kind in COLUMNS.items())
        write_table(path, kept)


def _level(path: Path) -> int:
    first, dash, _ = path.name.partition("-")
    return int(first) if dash and first.isdecimal() else 0


def _together(paths: Sequence[Path]) -> pl.DataFrame:
    """Return the outcomes of files, sorted by keys, without duplicates: of two, the first."""
    keys = list(TRIAL_COLUMNS)
    parts = [pl.DataFrame(schema=COLUMNS), *map(_read, paths)]
    outcomes = pl.concat(parts).sort(keys, maintain_order=True)
    repeated = pl.all_horizontal(pl.col(name) == pl.col(name).shift() for name in keys)
    new = outcomes.select(~repeated.fill_null(value=False)).to_series()
    return outcomes if new.all() else outcomes.filter(new)


def _read(path: Path) -> pl.DataFrame:
    try:
        part = read_parquet(path)
    except FormatError as error:
        raise FormatError(
            path, f"is damaged ({error.problem}); remove it, and its trials are run again"
        ) from error
    if not set(_ADDED) & set(part.columns):
        added = (pl.lit(value, COLUMNS[name]).alias(name) for name, value in _ADDED.items())
        known = [name for name in COLUMNS if name in (*part.columns, *_ADDED)]
        part = part.with_columns(added).select(known)
    if dict(part.schema) != COLUMNS:
        raise FormatError(path, f"should have the columns {', '.join(COLUMNS)}")
    return part


def _short(value: object) -> str:
    text = "absent" if value is None else str(value)
    is_hash = len(text) == 64 and not set(text) - set("0123456789abcdef")
    return text[:8] if is_hash else text
