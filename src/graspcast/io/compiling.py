"""Compilation by numba, with machine code kept on disk where that is possible."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import IO, Any

from numba import njit

from graspcast.errors import InputError
from graspcast.io.files import atomic_write

__all__ = ["cached_njit"]


def cached_njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return ``numba.njit(cache=True, **options)``, which also works where nothing can be cached.

    numba refuses to compile if neither the installation nor the user's cache directory can be
    written, and fails if the disk is full. Here the function is then compiled in each process.
    Temporary files that killed processes left beside the machine code are removed when more is
    written; numba leaves them for ever.
    """

    def compile_function(function: Callable[..., Any]) -> Any:
        try:
            compiled = njit(cache=True, **options)(function)
        except (OSError, RuntimeError):  # no source file, or no writable directory
            return njit(**options)(function)
        cache = getattr(compiled, "_cache", None)
        save = getattr(cache, "save_overload", None)
        if cache is not None and save is not None:  # pragma: no branch - private to numba
            cache.save_overload = _lenient(save)
        files = getattr(cache, "_cache_file", None)
        if files is not None and hasattr(files, "_open_for_write"):  # pragma: no branch
            files._open_for_write = _open_for_write
        return compiled

    return compile_function


def _lenient(save: Callable[..., None]) -> Callable[..., None]:
    def save_if_possible(*arguments: Any) -> None:
        with suppress(OSError, InputError):
            save(*arguments)

    return save_if_possible


@contextmanager
def _open_for_write(path: str) -> Iterator[IO[bytes]]:
    with atomic_write(path) as temporary, temporary.open("wb") as stream:
        yield stream
