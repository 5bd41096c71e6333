"""The attempt log: one SQLite file with every decision and outcome, one writer, many readers."""

from __future__ import annotations

import os
import socket
import sqlite3
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from os import PathLike
from pathlib import Path
from typing import Any

import polars as pl

from graspcast._version import __version__
from graspcast.attempt_log.checking import check_rows
from graspcast.attempt_log.database import connect_reading, connect_writing, in_words
from graspcast.attempt_log.records import FrameRecord, OutcomeRecord
from graspcast.attempt_log.rows import utc_text
from graspcast.attempt_log.tables import (
    Wanted,
    decisions_table,
    estimates_table,
    frames_table,
    outcomes_table,
    whole_table,
)
from graspcast.attempt_log.writing import insert_frame, insert_outcome
from graspcast.errors import GraspcastError, InputError
from graspcast.io.arguments import PATH, a, checked, sequence
from graspcast.io.locks import exclusive_lock

__all__ = ["AttemptLog"]


class AttemptLog:
    """A log of decisions and outcomes that survives kills and power loss.

    ::

        with AttemptLog.open("log.db") as log:  # the one writer
            log.add([FrameRecord(...)])
            log.add_outcome(OutcomeRecord(decision_id, success=True))
        AttemptLog.read("log.db").table()  # any number of readers, also while it is written

    What :meth:`add` and :meth:`add_outcome` were given is on disk when they return. Threads may
    share one log; what they write at the same time is committed together. Nothing that was
    written is ever changed or removed.

    Use :meth:`open` and :meth:`read`.
    """

    def __init__(self, path: Path, writing: sqlite3.Connection | None, held: ExitStack):
        self.path = path
        self._connection = writing
        self._held = held
        self._pid = os.getpid()
        self._waiting: list[_Ticket] = []
        self._queue, self._commit = threading.Lock(), threading.Lock()

    @classmethod
    @checked(path=PATH)
    def open(cls, path: str | PathLike[str]) -> AttemptLog:
        """Open a log for writing; it is made if there is none.

        Raises
        ------
        InputError
            If another process writes to it (named by its id and host), or the place cannot be
            written.
        FormatError
            If the file is damaged, no attempt log, or one of a newer version.
        """
        path = Path(os.path.realpath(path))
        with ExitStack() as stack:
            message = f"{path}: another process writes to this log; it has one writer at a time"
            lock = path.with_name(path.name + ".lock")
            try:
                stack.enter_context(exclusive_lock(lock, message))
            except InputError as error:
                if str(error) == message:
                    raise InputError(f"{message}{_writer_of(path)}", parameters=("log",)) from error
                raise
            connection = connect_writing(path)
            stack.callback(connection.close)
            log = cls(path, connection, stack.pop_all())
        try:
            log._submit(_sign)
        except BaseException:
            log.close()
            raise
        return log

    @classmethod
    @checked(path=PATH)
    def read(cls, path: str | PathLike[str]) -> AttemptLog:
        """Open a log for reading, whether or not it is being written.

        Raises
        ------
        InputError
            If there is none, or it cannot be read.
        FormatError
            As :meth:`open`.
        """
        path = Path(os.path.realpath(path))
        log = cls(path, None, ExitStack())
        with log.reading():
            return log

    def __repr__(self) -> str:
        return f"AttemptLog({os.fspath(self.path)!r}, {'writer' if self._connection else 'reader'})"

    def __enter__(self) -> AttemptLog:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the log; records that were acknowledged need no closing to be kept."""
        with self._commit:
            connection, self._connection = self._connection, None
            if connection is not None and os.getpid() == self._pid:
                with suppress(sqlite3.Error):
                    connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
                self._held.close()

    @checked(frames=sequence(a(FrameRecord)))
    def add(self, frames: Sequence[FrameRecord]) -> None:
        """Write frames with their decisions, all or none; they are on disk when it returns.

        A frame that is there already, the same in all, is left as it is, so that one may try again
        after an error.

        Raises
        ------
        MismatchError
            If a decision's id is that of another decision.
        InputError
            If the disk is full or cannot be written. All that was acknowledged is kept, and the log
            can be written again when there is room.
        """
        frames = tuple(frames)
        if frames:
            self._submit(lambda connection: [insert_frame(connection, f) for f in frames])

    @checked(outcome=a(OutcomeRecord))
    def add_outcome(self, outcome: OutcomeRecord) -> bool:
        """Write what came of an attempt; it is on disk when it returns.

        Returns
        -------
        Whether it is new; False where the same success was recorded before.

        Raises
        ------
        InputError
            If there is no such decision, or as :meth:`add`.
        MismatchError
            If the opposite was recorded before, or the decision has no guide, so that nothing can
            have been tried. A decision to abstain may have an outcome, of a trial made in spite of
            it; monitors do not count it.
        """
        return bool(self._submit(lambda connection: insert_outcome(connection, outcome)))

    @contextmanager
    def reading(self) -> Iterator[sqlite3.Connection]:
        """Yield a connection that reads one state of the log, whatever is written meanwhile."""
        connection = connect_reading(self.path)
        try:
            with in_words(self.path):
                connection.execute("BEGIN")
                yield connection
        finally:
            connection.close()

    def check(self) -> dict[str, int]:
        """Check every page and every row, and return the numbers of frames, decisions, outcomes.

        Raises
        ------
        FormatError
            Naming the first row that is not as it was written.
        """
        with self.reading() as connection:
            return check_rows(connection, self.path)

    def table(self, wanted: Wanted | None = None) -> pl.DataFrame:
        """Return one row for each decision, in the log's order, with its outcome if there is one.

        Parameters
        ----------
        wanted
            Which decisions; all if None.
        """
        with self.reading() as connection:
            return whole_table(connection, wanted or Wanted())

    def decisions(self, *, after: int = 0) -> pl.DataFrame:
        """Return the decisions whose sequence number is larger, in the log's order."""
        with self.reading() as connection:
            return decisions_table(connection, after)

    def outcomes(self, *, after: int = 0) -> pl.DataFrame:
        """Return the outcomes whose own sequence number is larger, in the order they came in."""
        with self.reading() as connection:
            return outcomes_table(connection, after)

    def frames(self) -> pl.DataFrame:
        """Return the frames, with the cameras' poses as stored matrices."""
        with self.reading() as connection:
            return frames_table(connection)

    def estimates(self) -> pl.DataFrame:
        """Return the estimates of all frames, by frame, estimator and number."""
        with self.reading() as connection:
            return estimates_table(connection)

    def _submit(self, job: Callable[[sqlite3.Connection], Any]) -> Any:
        """Run a job in a transaction, together with those of other threads, and return its result.

        Whoever gets the lock commits all that is waiting.
        """
        ticket = _Ticket(job)
        with self._queue:
            self._waiting.append(ticket)
        with self._commit:
            if not ticket.done:
                with self._queue:
                    batch, self._waiting = self._waiting, []
                self._commit_all(batch)
        if ticket.error is not None:
            raise ticket.error
        return ticket.result

    def _commit_all(self, batch: Sequence[_Ticket]) -> None:
        try:
            connection = self._writable()
            with in_words(self.path):
                connection.execute("BEGIN IMMEDIATE")
                for ticket in batch:
                    ticket.run(connection)
                connection.execute("COMMIT")
        except BaseException as error:
            told = error
            if not isinstance(error, GraspcastError):
                # Other threads are not interrupted because this one is.
                told = InputError(f"{self.path}: writing was broken off; write the record again")
            for ticket in batch:
                ticket.error = ticket.error or told
            if self._connection is not None and self._connection.in_transaction:
                with suppress(sqlite3.Error):
                    self._connection.execute("ROLLBACK")
            if not isinstance(error, GraspcastError):
                raise
        finally:
            for ticket in batch:
                ticket.done = True

    def _writable(self) -> sqlite3.Connection:
        if self._connection is None:
            raise InputError(
                f"{self.path}: is closed, or open for reading only; AttemptLog.open opens it for "
                "writing"
            )
        if os.getpid() != self._pid:
            raise InputError(
                f"{self.path}: was opened by process {self._pid}, of which this one is a fork; "
                "open the log in the process that writes to it"
            )
        return self._connection


class _Ticket:
    """A job that waits for its transaction, and what came of it."""

    def __init__(self, job: Callable[[sqlite3.Connection], Any]):
        self.job = job
        self.result: Any = None
        self.error: BaseException | None = None
        self.done = False

    def run(self, connection: sqlite3.Connection) -> None:
        """Run the job; where it refuses its record, the others of the transaction stay."""
        connection.execute("SAVEPOINT job")
        try:
            self.result = self.job(connection)
        except GraspcastError as error:
            self.error = error
            connection.execute("ROLLBACK TO job")
        connection.execute("RELEASE job")


def _sign(connection: sqlite3.Connection) -> None:
    """Write who writes from now on."""
    connection.execute(
        "INSERT INTO writer (pid, host, version, time_utc) VALUES (?, ?, ?, ?)",
        (os.getpid(), socket.gethostname(), __version__, utc_text(None)),
    )


def _writer_of(path: Path) -> str:
    """Return the last writer in words, as far as it can be read."""
    try:
        connection = connect_reading(path)
    except GraspcastError:
        return ""
    try:
        last = "SELECT pid, host FROM writer ORDER BY seq DESC LIMIT 1"
        row = connection.execute(last).fetchone()
    except sqlite3.Error:
        return ""
    finally:
        connection.close()
    return f": process {row[0]} on {row[1]}" if row else ""
