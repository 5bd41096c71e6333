"""Writing to the attempt log: frames with decisions, and outcomes, once each and in a chain."""

from __future__ import annotations

import sqlite3

from graspcast.attempt_log.records import FrameRecord, OutcomeRecord
from graspcast.attempt_log.rows import (
    DECISION_COLUMNS,
    ESTIMATE_COLUMNS,
    FIRST_CHAIN,
    FRAME_COLUMNS,
    chained,
    digest_of,
    outcome_row,
    rows_of,
)
from graspcast.errors import InputError, MismatchError

__all__ = ["insert_frame", "insert_outcome"]


def _insert(table: str, *columns: str) -> str:
    marks = ", ".join("?" * len(columns))
    return f"INSERT INTO {table} ({', '.join(columns)}) VALUES ({marks})"


_FRAME = _insert("frame", *FRAME_COLUMNS, "digest", "chain")
_ESTIMATE = _insert("estimate", "frame", *ESTIMATE_COLUMNS)
_DECISION = _insert("decision", "frame", *DECISION_COLUMNS)
_OUTCOME = _insert(
    "outcome", "decision", "decisions", "success", "reason", "time_utc", "digest", "chain"
)


def insert_frame(connection: sqlite3.Connection, record: FrameRecord) -> bool:
    """Write a frame with its decisions, and return whether it is new.

    Raises
    ------
    MismatchError
        If a decision's id is that of another decision.
    """
    rows = rows_of(record)
    same = "SELECT 1 FROM frame WHERE episode = ? AND look = ? AND digest = ?"
    if connection.execute(same, (record.episode, record.look, rows.digest)).fetchone():
        return False
    chain = chained(_last_chain(connection, "frame"), rows.digest)
    frame = connection.execute(_FRAME, (*rows.frame, rows.digest, chain)).lastrowid
    connection.executemany(_ESTIMATE, [(frame, *row) for row in rows.estimates])
    for row in rows.decisions:
        try:
            connection.execute(_DECISION, (frame, *row))
        except sqlite3.IntegrityError as error:
            if "decision.id" not in str(error):
                raise
            raise MismatchError(
                f"the log has a decision {row[0]} already, and it is another one; every decision "
                "needs an id of its own",
                parameters=("decision_id",),
            ) from error
    return True


def insert_outcome(connection: sqlite3.Connection, record: OutcomeRecord) -> bool:
    """Write an outcome, and return whether it is new.

    Raises
    ------
    InputError
        If there is no such decision.
    MismatchError
        If the opposite was recorded before, or the decision has no guide, so that nothing can have
        been tried.
    """
    decision = connection.execute(
        "SELECT seq, guide FROM decision WHERE id = ?", (record.decision_id,)
    ).fetchone()
    if decision is None:
        raise InputError(
            f"the log has no decision {record.decision_id!r:.100}; an id is given whole",
            parameters=("decision_id",),
        )
    number, guide = decision
    if guide is None:
        raise MismatchError(
            f"the decision {record.decision_id} has no pose that could guide a grasp, so nothing "
            "can have come of it",
            parameters=("decision_id",),
        )
    before = connection.execute(
        "SELECT success FROM outcome WHERE decision = ?", (number,)
    ).fetchone()
    row = outcome_row(record)
    if before is not None:
        if before[0] == row[0]:
            return False
        held = "succeeded" if before[0] else "failed"
        raise MismatchError(
            f"the log has the outcome of the decision {record.decision_id} already: it {held}. "
            "Outcomes are not changed",
            parameters=("decision_id", "success"),
        )
    there = connection.execute("SELECT max(seq) FROM decision").fetchone()[0]
    digest = digest_of((record.decision_id, there, *row))
    chain = chained(_last_chain(connection, "outcome"), digest)
    connection.execute(_OUTCOME, (number, there, *row, digest, chain))
    return True


def _last_chain(connection: sqlite3.Connection, table: str) -> bytes:
    row = connection.execute(f"SELECT chain FROM {table} ORDER BY seq DESC LIMIT 1").fetchone()
    return row[0] if row else FIRST_CHAIN
