"""Disk space: checked before it is needed, and reported where it has run out."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from graspcast.errors import DownloadError, InputError

__all__ = ["check_space", "in_words", "writing"]


def in_words(size: int) -> str:
    """Return a number of bytes in kB, MB or GB, as disks and servers count them."""
    for unit, bytes_ in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= bytes_:
            return f"{size / bytes_:.3g} {unit}"
    return f"{size} bytes"


def check_space(
    path: Path, needed: int, spare: int, *, size: int | None = None, most: int | None = None
) -> None:
    """Raise where what is about to be written has no place, or is too large.

    Parameters
    ----------
    path
        The file or folder; it need not exist.
    needed, spare
        Bytes that are to be written, and that must be left.
    size, most
        Size of the whole, by default ``needed``, and the largest that is allowed.

    Raises
    ------
    DownloadError
        If it is too large.
    InputError
        If the disk has no space for it.
    """
    whole = needed if size is None else size
    if most is not None and whole > most:
        raise DownloadError(
            f"{path.name}: is {in_words(whole)}, more than its limit of {in_words(most)}"
        )
    folder = next(p for p in (path, *path.parents) if p.is_dir())
    free = shutil.disk_usage(folder).free
    if needed + spare > free:
        raise InputError(
            f"{folder}: {in_words(needed)} are needed for {path.name}, and {in_words(free)} are "
            "free; make room, or name another directory by GRASPCAST_CACHE"
        )


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn a failed write in the block into an error that names the file.

    Raises
    ------
    InputError
        If the disk is full or cannot be written.
    """
    try:
        yield
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror or error}); GRASPCAST_CACHE names another "
            "directory"
        ) from error
