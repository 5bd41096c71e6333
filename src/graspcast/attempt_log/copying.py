"""Copies of an attempt log, also while it is written: one state, in one file."""

from __future__ import annotations

import sqlite3
from os import PathLike

from graspcast.attempt_log.database import in_words
from graspcast.attempt_log.log import AttemptLog
from graspcast.io.arguments import PATH, a, checked
from graspcast.io.files import atomic_write

__all__ = ["copy_log"]


@checked(log=a(AttemptLog), path=PATH)
def copy_log(log: AttemptLog, path: str | PathLike[str]) -> None:
    """Write a copy of a log, atomically, that needs no other file beside it.

    Parameters
    ----------
    log
        Open for reading or writing; others may go on writing to it.
    path
        Of the copy.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    with log.reading() as connection, atomic_write(path) as temporary, in_words(temporary):
        copy = sqlite3.connect(temporary, isolation_level=None)
        try:
            connection.backup(copy)
            copy.execute("PRAGMA journal_mode = DELETE")
        finally:
            copy.close()
