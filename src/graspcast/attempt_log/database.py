"""The SQLite file of the attempt log: opened and checked, and its errors in words."""

from __future__ import annotations

import os
import sqlite3
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from os import PathLike
from pathlib import Path
from urllib.parse import quote

import polars as pl

from graspcast.attempt_log.schema import APPLICATION_ID, STATEMENTS, TABLES, VERSION
from graspcast.errors import FormatError, GraspcastError, InputError

__all__ = ["check_file", "connect_reading", "connect_writing", "in_words"]

_BUSY_S = 5.0
_CHECKED_BYTES = 256 * 1024**2
"""Up to this size a file's pages are all checked when it is opened for writing."""
_WAL_LIMIT = 64 * 1024**2
_MOUNTS = "/proc/self/mounts"
_NETWORK = ("nfs", "cifs", "smb", "afs", "lustre", "glusterfs", "ceph", "fuse.sshfs", "9p.drvfs")


@contextmanager
def in_words(path: str | PathLike[str]) -> Iterator[None]:
    """Raise SQLite's errors as graspcast's, which say what to do.

    Raises
    ------
    FormatError
        If the file is damaged or no attempt log.
    InputError
        If the disk is full, the file is locked, or it cannot be read or written.
    """
    try:
        yield
    except sqlite3.Error as error:
        raise _told(Path(path), error) from error
    except (UnicodeDecodeError, *_NO_VALUES) as error:
        raise _damaged(Path(path), str(error)) from error


def connect_reading(path: Path) -> sqlite3.Connection:
    """Return a new connection that can only read.

    Raises
    ------
    FormatError, InputError
        As :func:`in_words`, and if it is not an attempt log of a known version.
    """
    check_file(path, there=True)
    with in_words(path):
        try:
            connection = _reading(path)
        except sqlite3.OperationalError as error:
            # Without write permission in the directory, SQLite can make no shared memory.
            unfinished = _size(path.with_name(path.name + "-wal"))
            if _name_of(error) not in _CANNOT_OPEN or unfinished:
                raise
            connection = _reading(path, "&immutable=1")
    return connection


def connect_writing(path: Path) -> sqlite3.Connection:
    """Return a connection that writes durably, after making or checking the log.

    Raises
    ------
    FormatError, InputError
        As :func:`connect_reading`, and for a file system on which SQLite cannot write safely.
    """
    check_file(path, there=False)
    _refuse_network(path)
    with in_words(path):
        connection = sqlite3.connect(
            path, timeout=_BUSY_S, isolation_level=None, check_same_thread=False
        )
        try:
            if not _is_empty(connection):
                _check(connection, path)
                if _size(path) <= _CHECKED_BYTES:
                    _check_pages(connection, path)
            _set_up(connection, path)
        except BaseException:
            with suppress(sqlite3.Error):
                connection.close()
            raise
    return connection


def check_file(path: Path, *, there: bool) -> None:
    """Raise unless the path is a regular file, or may become one.

    Raises
    ------
    InputError
        If it is a directory or a device; and, if it should be there, if it is missing or empty.
    """
    try:
        kind = path.stat()
    except FileNotFoundError as error:
        if there:
            raise InputError(f"{path}: there is no attempt log", parameters=("log",)) from error
        return
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    if not stat.S_ISREG(kind.st_mode):
        what = "a directory" if stat.S_ISDIR(kind.st_mode) else "no regular file"
        raise InputError(f"{path}: is {what}; an attempt log is one file", parameters=("log",))
    if there and not kind.st_size and not _size(path.with_name(path.name + "-wal")):
        raise InputError(
            f"{path}: is empty: nothing has been written to this log yet", parameters=("log",)
        )


def _reading(path: Path, more: str = "") -> sqlite3.Connection:
    uri = f"file:{quote(os.fspath(path.absolute()))}?mode=ro{more}"
    connection = sqlite3.connect(
        uri, uri=True, timeout=_BUSY_S, isolation_level=None, check_same_thread=False
    )
    try:
        _check(connection, path)
    except BaseException:
        connection.close()
        raise
    return connection


def _is_empty(connection: sqlite3.Connection) -> bool:
    """Return whether nothing was made in the file yet, as after a kill before the first commit."""
    tables = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    return tables == 0 and _pragma(connection, "application_id") in (0, APPLICATION_ID)


def _check(connection: sqlite3.Connection, path: Path) -> None:
    """Raise unless the file is an attempt log of this version."""
    found, version = (_pragma(connection, name) for name in ("application_id", "user_version"))
    if found != APPLICATION_ID:
        empty = _is_empty(connection)
        raise FormatError(
            path,
            "holds no log yet; its writer ended before the first record"
            if empty
            else "is a SQLite file of another program, not an attempt log; name another file",
            parameters=("log",),
        )
    if version != VERSION:
        remedy = "update graspcast" if version > VERSION else "start a new log"
        raise FormatError(
            path,
            f"is an attempt log of version {version}, and this graspcast knows version {VERSION}; "
            f"{remedy}",
            parameters=("log",),
        )
    made = dict(connection.execute("SELECT name, sql FROM sqlite_master WHERE type = 'table'"))
    wrong = sorted(name for name, sql in TABLES.items() if made.get(name) != sql)
    triggers = connection.execute("SELECT count(*) FROM sqlite_master WHERE type = 'trigger'")
    if wrong or triggers.fetchone()[0] != 2 * len(TABLES):
        what = f"the table {wrong[0]} is" if wrong else "the triggers that refuse changes are"
        raise FormatError(
            path,
            f"was changed by another program: {what} not as graspcast makes it; keep it aside, and "
            "go on with a copy made before or a new log",
            parameters=("log",),
        )


def _check_pages(connection: sqlite3.Connection, path: Path) -> None:
    found = connection.execute("PRAGMA quick_check(1)").fetchone()[0]
    if found != "ok":
        raise _damaged(path, found)


def _set_up(connection: sqlite3.Connection, path: Path) -> None:
    """Set how the connection writes, and make the tables if there are none."""
    mode = connection.execute("PRAGMA journal_mode = WAL").fetchone()[0]
    if mode != "wal":
        raise InputError(
            f"{path}: SQLite cannot keep a write-ahead log on this file system; keep the attempt "
            "log on a local disk",
            parameters=("log",),
        )
    for setting in (
        "synchronous = FULL",
        "fullfsync = ON",
        "foreign_keys = ON",
        "trusted_schema = OFF",
        f"journal_size_limit = {_WAL_LIMIT}",
        "wal_autocheckpoint = 1000",
    ):
        connection.execute(f"PRAGMA {setting}")
    if _is_empty(connection):
        connection.execute("BEGIN IMMEDIATE")
        for statement in STATEMENTS:
            connection.execute(statement)
        connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        connection.execute(f"PRAGMA user_version = {VERSION}")
        connection.execute("COMMIT")


def _pragma(connection: sqlite3.Connection, name: str) -> int:
    return int(connection.execute(f"PRAGMA {name}").fetchone()[0])


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _refuse_network(path: Path) -> None:
    """Raise on a network file system, where neither locks nor shared memory can be relied on."""
    try:
        mounts = Path(_MOUNTS).read_text(errors="replace").splitlines()
    except OSError:
        return  # not Linux
    folder = os.path.realpath(path.parent)
    best, kind = "", ""
    for line in mounts:
        _, point, found, *_ = line.split(" ")
        inside = folder == point or folder.startswith(point.rstrip("/") + "/")
        if inside and len(point) >= len(best):
            best, kind = point, found
    if kind.startswith(_NETWORK):
        raise InputError(
            f"{path}: is on a network file system ({kind}), on which a log would not survive a "
            "crash; keep it on a local disk and copy it",
            parameters=("log",),
        )


_NO_VALUES = (pl.exceptions.PolarsError, OverflowError, TypeError, ValueError)
"""What tables raise for values that no writer writes."""
_CANNOT_OPEN = ("SQLITE_CANTOPEN", "SQLITE_READONLY_DIRECTORY", "SQLITE_READONLY_CANTINIT")


def _first_line(text: str) -> str:
    """Return what fits a message, without what a terminal would take for a command."""
    lines = [line for line in text.splitlines() if line.strip("* ")] or ["?"]
    return "".join(c if c.isprintable() else "?" for c in lines[0])[:200]


def _damaged(path: Path, what: str) -> FormatError:
    return FormatError(
        path,
        f"is damaged ({_first_line(what)}); keep it aside, and go on with a copy of it or a "
        "new log (sqlite3's .recover saves what can be read)",
        parameters=("log",),
    )


def _name_of(error: sqlite3.Error) -> str:
    """Return SQLite's name of an error; Python's own errors have none."""
    return getattr(error, "sqlite_errorname", None) or ""


def _told(path: Path, error: sqlite3.Error) -> GraspcastError:
    """Return the error that says what to do."""
    name = _name_of(error)
    if name == "SQLITE_NOTADB":
        return FormatError(
            path, "is no attempt log (no SQLite file); name another file", parameters=("log",)
        )
    if name.startswith("SQLITE_CORRUPT") or "Could not decode to UTF-8" in str(error):
        return _damaged(path, str(error))
    if name.startswith(("SQLITE_FULL", "SQLITE_IOERR")):
        why = "the disk is full" if name == "SQLITE_FULL" else f"the disk failed ({error})"
        return InputError(
            f"{path}: {why}; what was being written is not recorded, all before it is. Make room "
            "or mend the disk, and write it again: the log goes on",
            parameters=("log",),
        )
    if name.startswith(("SQLITE_BUSY", "SQLITE_LOCKED", "SQLITE_PROTOCOL")):
        return InputError(
            f"{path}: is locked by another program (perhaps a shell of sqlite3); end its "
            "transaction and try again",
            parameters=("log",),
        )
    if name.startswith("SQLITE_CONSTRAINT"):
        return InputError(f"{path}: refuses the record ({error})", parameters=("log",))
    unfinished = _size(path.with_name(path.name + "-wal"))
    more = ""
    if unfinished and name in _CANNOT_OPEN:
        more = f"; {path.name}-wal beside it holds records too, so copy both to where you may write"
    return InputError(f"{path}: cannot be read or written ({error}){more}", parameters=("log",))
