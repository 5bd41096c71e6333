"""Arrays in npz files: read by name, without pickle, with limits, and checked by a digest.

An npz file is a zip archive of npy files. What an archive declares is checked before anything is
unpacked: a few megabytes can otherwise unpack to many gigabytes.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Mapping
from os import PathLike
from typing import Any

import numpy as np
from numpy import ndarray

from graspcast.errors import FormatError, InputError
from graspcast.io.artefacts import without_digest
from graspcast.io.files import atomic_write
from graspcast.io.hashing import sha256
from graspcast.io.reading import read_bytes

__all__ = ["MAX_UNPACKED_BYTES", "arrays_digest", "read_arrays", "write_arrays"]

MAX_UNPACKED_BYTES = 2**29
"""Most bytes that all arrays of a file may have together, unpacked."""

_DIGEST = "sha256"
_SUFFIX = ".npy"
_KINDS = "biufU"  # of numbers, truth values and text: neither objects nor records
_MAX_HEADER_BYTES = 10_000


def write_arrays(
    path: str | PathLike[str], arrays: Mapping[str, ndarray], *, compress: bool = True
) -> None:
    """Write an npz file atomically, with a digest of its arrays.

    Parameters
    ----------
    path
        The file.
    arrays
        Name to array, of numbers, truth values or text. ``sha256`` is the digest's own name.
    compress
        Whether to compress them.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    buffer = io.BytesIO()
    named: dict[str, Any] = {**arrays, _DIGEST: np.array(arrays_digest(arrays))}
    # np.savez of NumPy before 2.1 would take allow_pickle=False for an array of that name.
    if objects := [name for name, array in named.items() if np.asarray(array).dtype.hasobject]:
        raise InputError(
            f"{path}: {', '.join(objects)} holds objects; an npz file keeps arrays alone"
        )
    (np.savez_compressed if compress else np.savez)(buffer, **named)
    # Through memory, so that a full disk raises an OSError, which atomic_write handles.
    with atomic_write(path) as temporary:
        temporary.write_bytes(buffer.getvalue())


def read_arrays(
    path: str | PathLike[str],
    remedy: str,
    *,
    digest: bool = True,
    limit: int = MAX_UNPACKED_BYTES,
) -> dict[str, Any]:
    """Read all arrays of an npz file.

    Parameters
    ----------
    path
        The file.
    remedy
        What to do about a file that is damaged or has no digest, as ``"train it again"``.
    digest
        Whether it must have the digest that :func:`write_arrays` gives it.
    limit
        The most bytes of all its arrays together.

    Raises
    ------
    FormatError
        If it cannot be read, is damaged, has no digest, holds anything but arrays of numbers,
        truth values and text, or more than ``limit``.
    """
    content = read_bytes(path)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = _members(archive, limit)
            arrays: dict[str, Any] = {name: _array(archive, info) for name, info in members.items()}
    except Exception as error:  # those of zipfile, zlib and NumPy's header parser have no base
        raise FormatError(path, f"is not a complete npz file ({error}); {remedy}") from error
    if not digest:
        return arrays
    stated = arrays.pop(_DIGEST, None)
    if stated is None:
        raise without_digest(path, remedy)
    if stated.dtype.kind != "U" or stated.tobytes() != np.array(arrays_digest(arrays)).tobytes():
        raise FormatError(path, f"is damaged: its arrays do not match its digest; {remedy}")
    return arrays


def _members(archive: zipfile.ZipFile, limit: int) -> dict[str, zipfile.ZipInfo]:
    """Return the archive's members by the array's name; raise ValueError for what is odd."""
    members: dict[str, zipfile.ZipInfo] = {}
    for info in archive.infolist():
        name = info.filename.removesuffix(_SUFFIX)
        if name == info.filename:
            raise ValueError(f"{name!r} is no array")
        if name in members:
            raise ValueError(f"{name!r} is there twice")
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"{name!r} is compressed in an unusual way")
        members[name] = info
    if not members:
        raise ValueError("it holds no arrays")
    if (size := sum(info.file_size for info in members.values())) > limit:
        raise ValueError(f"its arrays have {size:,} bytes, more than the {limit:,} that are read")
    return members


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> ndarray:
    """Read one array; raise ValueError unless its header declares just the bytes that follow."""
    with archive.open(info) as stream:
        version = np.lib.format.read_magic(stream)
        readers = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }
        if version not in readers:
            raise ValueError(f"{info.filename} is of npy version {version}")
        shape, fortran, dtype = readers[version](stream, max_header_size=_MAX_HEADER_BYTES)
        size = math.prod(shape) * dtype.itemsize
        if dtype.kind not in _KINDS or dtype.subdtype or any(n < 0 for n in shape):
            raise ValueError(f"{info.filename} holds {dtype}")
        if size != info.file_size - stream.tell():
            raise ValueError(f"{info.filename} does not have the {size:,} bytes of its shape")
        content = stream.read()  # the archive's CRC is checked at its end
    if len(content) != size:
        raise ValueError(f"{info.filename} is cut off")
    array = np.frombuffer(bytearray(content), dtype=dtype) if size else np.empty(0, dtype)
    # The copy of bytes is writable, as an array that NumPy reads is.
    return array.reshape(shape, order="F" if fortran else "C")


def arrays_digest(arrays: Mapping[str, ndarray]) -> str:
    """Compute the digest of names, types, shapes and numbers, whatever the arrays' order."""
    parts: list[str | ndarray] = []
    for name in sorted(arrays):
        array = np.asarray(arrays[name])
        parts += [f"{name}\n{array.dtype.str}\n{array.shape}\n", array]
    return sha256(*parts)
