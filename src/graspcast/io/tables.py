"""Tables as CSV and Parquet; a damaged file is an error, and never a crash.

polars aborts the whole process on some damaged Parquet files (it tries to allocate 2 EiB, for
example), which no ``except`` can catch. So Parquet files written by :func:`write_table` carry a
SHA-256 digest of their own bytes, which is verified before they are parsed. Any other Parquet file
is first parsed in a child process.
"""

from __future__ import annotations

import io
import re
import subprocess
import sys
from os import PathLike
from pathlib import Path

import polars as pl

from graspcast.errors import FormatError
from graspcast.io.compression import compressed, utf_16
from graspcast.io.files import atomic_write
from graspcast.io.hashing import sha256
from graspcast.io.reading import other_separator, read_bytes

__all__ = ["parquet_bytes", "read_csv", "read_parquet", "write_table"]

_DIGEST_KEY = "graspcast:sha256"
_UNSET = "0" * 64
_HEADER = 2**16
"""Bytes in which the header of a CSV file is looked at."""
_MARK = "graspcast:carries-digest"
"""A second mark: a file whose digest has a damaged key does not pass as another program's."""
# In a Parquet footer a key and its value are strings of the Thrift compact protocol; between them
# stand a field header and the value's length.
_DIGEST = re.compile(_DIGEST_KEY.encode() + rb".{1,4}?([0-9a-f]{64})", re.DOTALL)

_CHILD = "import io, sys, polars; polars.read_parquet(io.BytesIO(sys.stdin.buffer.read()))"
_CHILD_SECONDS = 120


def write_table(path: str | PathLike[str], frame: pl.DataFrame) -> None:
    """Write a table atomically, as Parquet (with a digest) or CSV by the path's ending.

    Parameters
    ----------
    path
        A name that ends in ``.parquet`` gives Parquet, any other CSV.
    frame
        The table.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    if Path(path).suffix == ".parquet":
        content = parquet_bytes(frame)
    else:
        content = frame.write_csv().encode()
    # Through memory, so that a full disk raises an OSError, which atomic_write handles.
    with atomic_write(path) as temporary:
        temporary.write_bytes(content)


def parquet_bytes(frame: pl.DataFrame) -> bytes:
    """Return a table as the bytes of a Parquet file that carries its own SHA-256 digest."""
    buffer = io.BytesIO()
    frame.write_parquet(buffer, metadata={_DIGEST_KEY: _UNSET, _MARK: "true"})
    content = buffer.getvalue()
    start = _digest_start(content)
    if start is None:  # pragma: no cover - a polars that stores metadata in another way
        raise RuntimeError("polars did not store the digest as expected")
    digest = sha256(content)
    return content[:start] + digest.encode() + content[start + 64 :]


def read_parquet(path: str | PathLike[str]) -> pl.DataFrame:
    """Read a Parquet file, however damaged it may be.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    FormatError
        If the file cannot be read, its digest does not match, or it is not Parquet.
    """
    path = Path(path)
    content = read_bytes(path)
    start = _digest_start(content)
    if start is None and (_DIGEST_KEY.encode() in content or _MARK.encode() in content):
        raise FormatError(path, "is damaged: the digest that graspcast wrote is not whole")
    if start is None:
        _parse_in_child(path, content)
    else:
        unset = content[:start] + _UNSET.encode() + content[start + 64 :]
        if sha256(unset).encode() != content[start : start + 64]:
            raise FormatError(path, "is damaged: its content does not match its digest")
    try:
        return pl.read_parquet(io.BytesIO(content))
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError) as error:
        raise FormatError(path, f"is not a Parquet file ({_first_line(error)})") from error


def read_csv(path: str | PathLike[str]) -> pl.DataFrame:
    """Read a CSV file with a header line; types are inferred from all rows.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    FormatError
        If the file cannot be read or is not CSV.
    """
    content = read_bytes(path)
    said = compressed(content)  # polars would unpack it, to any size
    said = said or utf_16(content)
    if said := said or other_separator(content[:_HEADER].decode(errors="replace")):
        raise FormatError(path, said)
    try:
        return pl.read_csv(io.BytesIO(content), infer_schema_length=None)
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError) as error:
        raise FormatError(path, f"is not a CSV file ({_first_line(error)})") from error


def _digest_start(content: bytes) -> int | None:
    """Return where the digest's 64 hexadecimal digits begin, None if there is no digest."""
    key = content.rfind(_DIGEST_KEY.encode())
    found = _DIGEST.match(content, key) if key >= 0 else None
    return found.start(1) if found else None


def _parse_in_child(path: Path, content: bytes) -> None:
    """Parse a Parquet file in a child process, which polars may abort.

    Raises
    ------
    FormatError
        If the child fails, dies or takes too long.
    """
    # -P: a polars.py in the working directory is not the library.
    command = [sys.executable, "-P", "-c", _CHILD]
    try:
        child = subprocess.run(
            command, input=content, capture_output=True, timeout=_CHILD_SECONDS, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise FormatError(
            path, f"is not a Parquet file (it took longer than {_CHILD_SECONDS} s to parse)"
        ) from error
    if child.returncode != 0:
        lines = child.stderr.decode(errors="replace").strip().splitlines()
        # An exception ends with its message; an abort begins with it, and a backtrace follows.
        aborted = child.returncode < 0 or not any(line.startswith("Traceback") for line in lines)
        said = (lines[0] if aborted else lines[-1]) if lines else f"status {child.returncode}"
        raise FormatError(path, f"is not a Parquet file ({said})")


def _first_line(error: BaseException) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]
