"""Tables of the attempt log: decisions with their outcomes, frames and estimates, as polars."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import polars as pl

from graspcast.attempt_log.rows import utc_text

__all__ = [
    "Wanted",
    "decisions_table",
    "estimates_table",
    "frames_table",
    "outcomes_table",
    "whole_table",
]

_TIME = pl.Datetime("us", "UTC")
_DECISION: dict[str, Any] = {
    "seq": pl.Int64,
    "id": pl.String,
    "episode": pl.String,
    "look": pl.Int64,
    "frame": pl.Int64,
    "time_utc": _TIME,
    "source": pl.String,
    "instance": pl.Int64,
    "object_name": pl.String,
    "action": pl.String,
    "probability": pl.Float64,
    "threshold": pl.Float64,
    "guarantee": pl.String,
    "reason": pl.String,
    "guide": pl.String,
    "gripper": pl.String,
    "grasp": pl.String,
    "views": pl.Int64,
    "looks": pl.Int64,
    "model": pl.String,
    "certificate": pl.String,
    "cam_T_obj": pl.Binary,
    "world_T_obj": pl.Binary,
}
_OUTCOME: dict[str, Any] = {
    "outcome_seq": pl.Int64,
    "success": pl.Boolean,
    "outcome_reason": pl.String,
    "outcome_time_utc": _TIME,
}
_OWN_OUTCOME: dict[str, Any] = {
    "seq": pl.Int64,
    "decision_id": pl.String,
    "success": pl.Boolean,
    "reason": pl.String,
    "time_utc": _TIME,
    "chain": pl.Binary,
}
_FRAME: dict[str, Any] = {
    "seq": pl.Int64,
    "episode": pl.String,
    "look": pl.Int64,
    "time_utc": _TIME,
    "world_T_cam": pl.Binary,
    "K": pl.Binary,
    "estimators": pl.String,
    "model": pl.String,
    "certificate": pl.String,
    "source": pl.String,
}
_ESTIMATE: dict[str, Any] = {
    "frame": pl.Int64,
    "estimator": pl.String,
    "number": pl.Int64,
    "object_name": pl.String,
    "cam_T_obj": pl.Binary,
    "score": pl.Float64,
}
_OF_FRAME = ("episode", "look", "time_utc", "source")


@dataclass(frozen=True)
class Wanted:
    """Which decisions of a log are wanted.

    Attributes
    ----------
    objects, grippers, grasps, actions, models
        Names (of models, digests or their beginnings), all if empty.
    since, until
        Times between which the decisions were made, until the second exclusively, or None.
    with_outcome
        Those with an outcome, or those without; None for all.
    after
        Those whose sequence number is larger.
    last
        So many at the end, or None.
    """

    objects: Sequence[str] = ()
    grippers: Sequence[str] = ()
    grasps: Sequence[str] = ()
    actions: Sequence[str] = ()
    models: Sequence[str] = ()
    since: datetime | None = None
    until: datetime | None = None
    with_outcome: bool | None = None
    after: int = 0
    last: int | None = None

    def condition(self) -> tuple[str, list[Any]]:
        """Return the condition of SQL and its values."""
        terms: list[str] = ["d.seq > ?"]
        values: list[Any] = [self.after]
        for column, names in (
            ("object_name", self.objects),
            ("gripper", self.grippers),
            ("grasp", self.grasps),
            ("action", self.actions),
        ):
            if names:
                terms.append(f"d.{column} IN ({', '.join('?' * len(names))})")
                values += names
        if self.models:
            same = " OR ".join(["substr(d.model, 1, ?) = ?"] * len(self.models))
            terms.append(f"({same})")
            values += [value for name in self.models for value in (len(name), name)]
        for time, comparison in ((self.since, ">="), (self.until, "<")):
            if time is not None:
                terms.append(f"f.time_utc {comparison} ?")
                values.append(utc_text(time.astimezone(UTC)))
        if self.with_outcome is not None:
            terms.append(f"o.seq IS {'NOT ' * self.with_outcome}NULL")
        return " AND ".join(terms), values


def whole_table(connection: sqlite3.Connection, wanted: Wanted) -> pl.DataFrame:
    """Return the wanted decisions with their outcomes."""
    condition, values = wanted.condition()
    columns = ", ".join(
        [
            *_columns(_DECISION),
            "o.seq AS outcome_seq, o.success, o.reason AS outcome_reason",
            "o.time_utc AS outcome_time_utc",
        ]
    )
    query = (
        f"SELECT {columns} FROM decision d JOIN frame f ON f.seq = d.frame "
        f"LEFT JOIN outcome o ON o.decision = d.seq WHERE {condition} ORDER BY d.seq"
    )
    if wanted.last is not None:
        query = f"SELECT * FROM ({query} DESC LIMIT ?) ORDER BY seq"
        values.append(wanted.last)
    return _table(connection.execute(query, values).fetchall(), _DECISION | _OUTCOME)


def decisions_table(connection: sqlite3.Connection, after: int = 0) -> pl.DataFrame:
    """Return the decisions after a sequence number, without outcomes."""
    return whole_table(connection, Wanted(after=after)).drop(*_OUTCOME)


def outcomes_table(connection: sqlite3.Connection, after: int = 0) -> pl.DataFrame:
    """Return the outcomes after a sequence number of their own."""
    rows = connection.execute(
        "SELECT o.seq, d.id, o.success, o.reason, o.time_utc, o.chain FROM outcome o "
        "JOIN decision d ON d.seq = o.decision WHERE o.seq > ? ORDER BY o.seq",
        (after,),
    )
    return _table(rows.fetchall(), _OWN_OUTCOME)


def frames_table(connection: sqlite3.Connection) -> pl.DataFrame:
    """Return the frames in the log's order."""
    rows = connection.execute(f"SELECT {', '.join(_FRAME)} FROM frame ORDER BY seq")
    return _table(rows.fetchall(), _FRAME)


def estimates_table(connection: sqlite3.Connection) -> pl.DataFrame:
    """Return the estimates by frame, estimator and number."""
    names = ", ".join(_ESTIMATE)
    rows = connection.execute(f"SELECT {names} FROM estimate ORDER BY frame, estimator, number")
    return _table(rows.fetchall(), _ESTIMATE)


def _columns(schema: dict[str, Any]) -> list[str]:
    return [f"{'f' if name in _OF_FRAME else 'd'}.{name}" for name in schema]


def _table(rows: list[Any], schema: dict[str, Any]) -> pl.DataFrame:
    """Return rows as a table: times are stored as text, truth as 0 or 1."""
    stored = {_TIME: pl.String, pl.Boolean: pl.Int64}
    raw = {name: stored.get(kind, kind) for name, kind in schema.items()}
    table = pl.DataFrame(rows, schema=raw, orient="row")
    times = [
        pl.col(n).str.to_datetime("%Y-%m-%dT%H:%M:%S%.fZ", time_unit="us", time_zone="UTC")
        for n, kind in schema.items()
        if kind == _TIME
    ]
    flags = [pl.col(n).cast(pl.Boolean) for n, kind in schema.items() if kind == pl.Boolean]
    return table.with_columns(*times, *flags)
