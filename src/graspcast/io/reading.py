"""Reading of files: regular files alone, of limited size.

Every file that graspcast reads goes through :func:`read_bytes`, or through :func:`check_regular`
where a library opens it. A pipe, a device or a socket may never end or may block for ever, so it is
refused; a symbolic link to a regular file is followed.
"""

from __future__ import annotations

import os
import stat
from os import PathLike
from pathlib import Path

from graspcast.errors import FormatError
from graspcast.io.compression import gunzipped, not_text

__all__ = [
    "MAX_BYTES",
    "MAX_TEXT_BYTES",
    "check_regular",
    "other_separator",
    "read_bytes",
    "read_text",
]

MAX_BYTES = 2**30
"""Most bytes of a file of data: tables, JSON, meshes, images, networks, models."""
MAX_TEXT_BYTES = 2**24
"""Most bytes of a file that is written by hand: TOML and MJCF."""

_KINDS = (
    (stat.S_ISDIR, "a directory"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


def read_bytes(path: str | PathLike[str], limit: int = MAX_BYTES) -> bytes:
    """Read a regular file.

    Parameters
    ----------
    path
        The file, or a symbolic link to it.
    limit
        The most bytes that it may have.

    Raises
    ------
    FormatError
        If it cannot be read, is not a regular file, or is larger.
    """
    # Checked by name first, since to open some devices has an effect; then again when it is open.
    check_regular(path, limit)
    try:
        # Without blocking, should a pipe have taken its place.
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | _O_BINARY)
        with os.fdopen(handle, "rb") as stream:
            _check(path, os.fstat(stream.fileno()), limit)
            content = stream.read() or b""
    except OSError as error:
        raise FormatError(path, f"cannot be read ({error.strerror or error})") from error
    if len(content) > limit:
        raise _too_large(path, len(content), limit)
    return content


_O_BINARY = getattr(os, "O_BINARY", 0)


def read_text(path: str | PathLike[str], limit: int = MAX_BYTES) -> str:
    """Read a regular file as UTF-8 text, with or without a byte order mark; gzip is unpacked.

    Line ends stay as they are.

    Raises
    ------
    FormatError
        As :func:`read_bytes`, or if it is not UTF-8, or a gzip file that is damaged or too large.
    """
    content = read_bytes(path, limit)
    try:
        content = gunzipped(content, limit)
    except ValueError as error:
        raise FormatError(path, str(error)) from error
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FormatError(path, not_text(content)) from error


def check_regular(path: str | PathLike[str], limit: int = MAX_BYTES) -> None:
    """Check that a file which another library opens by name is regular and not too large.

    Raises
    ------
    FormatError
        As :func:`read_bytes`.
    """
    try:
        found = Path(path).stat()
    except OSError as error:
        raise FormatError(path, f"cannot be read ({error.strerror or error})") from error
    except ValueError as error:  # a NUL character in the path
        raise FormatError(repr(path), f"is not a path ({error})") from error
    _check(path, found, limit)


def _check(path: str | PathLike[str], found: os.stat_result, limit: int) -> None:
    if not stat.S_ISREG(found.st_mode):
        kind = next((name for test, name in _KINDS if test(found.st_mode)), "something else")
        remedy = "" if kind == "a directory" else "; write its content to a file first"
        raise FormatError(path, f"is {kind}, not a regular file{remedy}")
    if found.st_size > limit:
        raise _too_large(path, found.st_size, limit)


def _too_large(path: str | PathLike[str], size: int, limit: int) -> FormatError:
    return FormatError(path, f"has {size:,} bytes; files of this kind are read up to {limit:,}")


def other_separator(text: str) -> str:
    """Say that a table's columns are separated by semicolons or tabs, or nothing."""
    header = text.partition("\n")[0]
    found = [name for mark, name in ((";", "semicolons"), ("\t", "tabs")) if mark in header]
    if "," in header or not found:
        return ""
    return (
        f"its columns are separated by {found[0]}; separate them by commas, and write decimals "
        "with a point"
    )
