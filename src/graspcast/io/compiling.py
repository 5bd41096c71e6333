"""Compilation by numba, with machine code kept on disk where that is possible."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from numba import njit

__all__ = ["cached_njit"]


def cached_njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return ``numba.njit(cache=True, **options)``, which also works where nothing can be cached.

    numba refuses to compile if neither the installation nor the user's cache directory can be
    written, and fails if the disk is full. Here the function is then compiled in each process.
    """

    def compile_function(function: Callable[..., Any]) -> Any:
        try:
            compiled = njit(cache=True, **options)(function)
        except (OSError, RuntimeError):  # no source file, or no writable directory
            return njit(**options)(function)
        cache = getattr(compiled, "_cache", None)
        save = getattr(cache, "save_overload", None)
        if cache is not None and save is not None:
            cache.save_overload = _lenient(save)
        return compiled

    return compile_function


def _lenient(save: Callable[..., None]) -> Callable[..., None]:
    def save_if_possible(*arguments: Any) -> None:
        with suppress(OSError):
            save(*arguments)

    return save_if_possible
