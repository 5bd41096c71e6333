"""Lock files, which keep two processes from writing to the same place."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path

from filelock import FileLock, Timeout

from graspcast.errors import InputError

__all__ = ["exclusive_lock"]


@contextmanager
def exclusive_lock(
    path: str | PathLike[str], message: str, *, wait_s: float = 0.0
) -> Iterator[None]:
    """Hold a lock file for the duration of the block.

    The operating system releases the lock when the process ends, even if it is killed.

    Parameters
    ----------
    path
        The lock file; it and its parent directories are created.
    message
        The error message if another process holds the lock.
    wait_s
        How long to wait for that process, seconds.

    Raises
    ------
    InputError
        If another process holds the lock, or the file cannot be written.
    """
    path = Path(path)
    lock = FileLock(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire(timeout=wait_s)
    except Timeout as error:
        raise InputError(message) from error
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from error
    try:
        yield
    finally:
        lock.release()
