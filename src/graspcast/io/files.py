"""Atomic file writes: a file has its old content or all of the new; temporary files are swept."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path

from graspcast.errors import InputError

_LOCKS = find_spec("fcntl") is not None  # not on Windows
if _LOCKS:
    import fcntl

__all__ = ["atomic_write", "check_target", "sweep", "temporary_directory", "write_text"]


_PREFIX, _SUFFIX = ".graspcast-", ".tmp"
_swept: set[Path] = set()


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside ``path``; rename it onto ``path`` if the block succeeds.

    If the block raises, the temporary file is removed and ``path`` stays as it was. Missing
    parent directories are created. A symbolic link is followed. Temporary files that killed
    processes left in the directory are removed.

    Raises
    ------
    InputError
        If ``path`` is a directory, a device or a pipe, the directory cannot be written, or the disk
        is full.
    """
    target = Path(os.path.realpath(path))  # through symbolic links, which stay
    _refuse_other_kinds(path, target, "out")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary, handle = _make(target.parent, _make_file)
    except OSError as error:
        raise InputError(
            f"{target}: cannot be written ({error.strerror})", parameters=("out",)
        ) from error
    try:
        yield temporary
        with temporary.open("rb+") as stream:
            os.fsync(stream.fileno())
        # mkstemp makes files private; an output file follows the umask like any other.
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        if not _LOCKS:
            handle = _close(handle)  # Windows renames no open file
        temporary.replace(target)
        _sync_directory(target.parent)
    except OSError as error:
        raise InputError(f"{target}: could not be written ({error.strerror})") from error
    finally:
        handle = _close(handle)
        with suppress(FileNotFoundError):
            temporary.unlink()


def check_target(path: str | os.PathLike[str], parameter: str = "out") -> None:
    """Raise where a file surely cannot be written, before the work that it is to hold.

    Parameters
    ----------
    path
        The file.
    parameter
        The parameter that names it.

    Raises
    ------
    InputError
        If it is a directory, a device or a pipe, or cannot be made in its directory.
    """
    target = Path(os.path.realpath(path))
    _refuse_other_kinds(path, target, parameter)
    parent = next(folder for folder in target.parents if folder.exists())
    problem = ""
    if not parent.is_dir():
        problem = f"{parent} is no directory"
    elif not os.access(parent, os.W_OK | os.X_OK):
        problem = f"{parent} may not be written to"
    if problem:
        raise InputError(f"{path}: cannot be written ({problem})", parameters=(parameter,))


def _refuse_other_kinds(path: str | os.PathLike[str], target: Path, parameter: str) -> None:
    """Raise if what is there is no file."""
    if target.exists() and not target.is_file():
        kind = "a directory" if target.is_dir() else "not a regular file"
        raise InputError(f"{path}: is {kind}, and would be replaced", parameters=(parameter,))


@contextmanager
def temporary_directory(parent: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a new directory in ``parent``; remove it with all it holds at the end of the block.

    What killed processes left in ``parent`` is removed, too.

    Raises
    ------
    InputError
        If ``parent`` cannot be written.
    """
    parent = Path(os.path.realpath(parent))
    try:
        parent.mkdir(parents=True, exist_ok=True)
        path, handle = _make(parent, _make_directory)
    except OSError as error:
        raise InputError(
            f"{parent}: cannot be written ({error.strerror})", parameters=("out",)
        ) from error
    try:
        yield path
    finally:
        _close(handle)
        shutil.rmtree(path, ignore_errors=True)


def sweep(directory: str | os.PathLike[str]) -> None:
    """Remove the temporary files and directories that killed processes left in a directory.

    One that a living process uses stays: the process holds a lock on it, which the operating
    system releases when the process ends. Without such locks (on Windows, and on some network
    file systems) nothing is removed.
    """
    if not _LOCKS:
        return
    with suppress(OSError):
        for path in Path(directory).glob(f"{_PREFIX}*{_SUFFIX}"):
            with suppress(OSError):
                _remove_unused(path)


def _remove_unused(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink()
    finally:
        os.close(handle)


def _make(parent: Path, make: Callable[[Path], tuple[int, str]]) -> tuple[Path, int]:
    """Make a temporary file or directory, and lock it so that no other process removes it."""
    if parent not in _swept:
        _swept.add(parent)
        sweep(parent)
    while True:
        handle, name = make(parent)
        path = Path(name)
        if not _LOCKS or handle < 0:
            return path, handle
        # Another process may remove it before it is locked; then another is made.
        with suppress(OSError):  # a file system without locks
            fcntl.flock(handle, fcntl.LOCK_EX)
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(handle), path.stat()):
                return path, handle
        os.close(handle)


def _make_file(parent: Path) -> tuple[int, str]:
    return tempfile.mkstemp(prefix=_PREFIX, suffix=_SUFFIX, dir=parent)


def _make_directory(parent: Path) -> tuple[int, str]:
    while True:
        name = tempfile.mkdtemp(prefix=_PREFIX, suffix=_SUFFIX, dir=parent)
        if not _LOCKS:
            return -1, name
        with suppress(FileNotFoundError):
            return os.open(name, os.O_RDONLY), name


def _close(handle: int) -> int:
    if handle >= 0:
        os.close(handle)
    return -1


def _sync_directory(directory: Path) -> None:
    """Make a rename last through a power failure, where directories can be synchronised."""
    if not _LOCKS:
        return
    with suppress(OSError):
        handle = os.open(directory, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write ``text`` atomically, as UTF-8 with Unix line ends.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
