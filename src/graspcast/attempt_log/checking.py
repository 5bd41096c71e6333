"""Checks of a whole attempt log: SQLite's own, numbers without gaps, and every row's digest."""

from __future__ import annotations

import sqlite3
from os import PathLike

from graspcast.attempt_log.rows import (
    DECISION_COLUMNS,
    ESTIMATE_COLUMNS,
    FIRST_CHAIN,
    FRAME_COLUMNS,
    chained,
    digest_of,
)
from graspcast.errors import FormatError

__all__ = ["check_rows"]


def check_rows(connection: sqlite3.Connection, path: str | PathLike[str]) -> dict[str, int]:
    """Check every page and every row of a log.

    Parameters
    ----------
    connection
        To the log.
    path
        For messages.

    Returns
    -------
    The numbers of frames, decisions and outcomes.

    Raises
    ------
    FormatError
        Naming the first row that is not as it was written.
    """
    for pragma, good in (("integrity_check(1)", "ok"), ("foreign_key_check", None)):
        found = connection.execute(f"PRAGMA {pragma}").fetchone()
        if found is not None and found[0] != good:
            raise FormatError(path, f"is damaged ({found[0]}); {_KEPT_ASIDE}")
    counts = {}
    for table in ("frame", "decision", "outcome"):
        count, last = connection.execute(
            f"SELECT count(*), coalesce(max(seq), 0) FROM {table}"
        ).fetchone()
        if count != last:
            raise FormatError(path, f"lacks {last - count} rows of its {table}s; {_KEPT_ASIDE}")
        counts[table] = count
    _check_chain(connection, path, "frame")
    _check_chain(connection, path, "outcome")
    return counts


_KEPT_ASIDE = "keep it aside, and go on with a copy made before or a new log"
_ESTIMATES = (
    f"SELECT {', '.join(ESTIMATE_COLUMNS)} FROM estimate WHERE frame = ? ORDER BY estimator, number"
)
_DECISIONS = f"SELECT {', '.join(DECISION_COLUMNS)} FROM decision WHERE frame = ? ORDER BY seq"
_ROWS = {
    "frame": f"SELECT seq, digest, chain, {', '.join(FRAME_COLUMNS)} FROM frame ORDER BY seq",
    "outcome": "SELECT o.seq, o.digest, o.chain, d.id, o.decisions, o.success, o.reason, "
    "o.time_utc FROM outcome o JOIN decision d ON d.seq = o.decision ORDER BY o.seq",
}


def _check_chain(connection: sqlite3.Connection, path: str | PathLike[str], table: str) -> None:
    chain = FIRST_CHAIN
    for seq, digest, found, *row in connection.execute(_ROWS[table]):
        rows = [row]
        if table == "frame":
            rows += connection.execute(_ESTIMATES, (seq,)).fetchall()
            rows += connection.execute(_DECISIONS, (seq,)).fetchall()
        chain = chained(chain, digest)
        if digest_of(*rows) != digest or chain != found:
            raise FormatError(path, f"{table} {seq} is not as it was written; {_KEPT_ASIDE}")
