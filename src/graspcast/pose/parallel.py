"""Compiled loops over rows, on the calling thread or on several.

A few rows are computed by the calling thread: starting others, and waiting for them where the
processors are busy, would take longer. More rows are dealt out to threads that live as long as the
call. Nothing is left behind: no pool of threads that a process could share with its fork, and no
lock. So calls from many threads at once, and calls after a fork (of a process that computes nothing
at that moment), are as safe as any other call. The threading layers of numba (``parallel=True``) do
not offer this: ``workqueue`` aborts in the first case, GNU's OpenMP in the second.

A kernel is compiled by ``numba.njit(nogil=True)``, and called ``kernel(start, stop, *arguments)``.
It computes the rows from ``start`` to ``stop`` and writes them into an array among its arguments,
so a result does not depend on the number of threads.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numba
import numpy as np

__all__ = ["over_rows"]

_LEAST_NS = 1_000_000
"""Work that is worth a thread: ten times as long as starting it."""
_CHUNKS = 4
"""Of each thread, so that all end at about the same time where a processor is busy otherwise."""


def over_rows(kernel: Callable[..., None], rows: int, row_ns: float, *arguments: Any) -> None:
    """Call a compiled kernel for all rows, on several threads where it is worth it.

    Parameters
    ----------
    kernel
        Compiled, without the global interpreter lock.
    rows
        Number of rows.
    row_ns
        About how many nanoseconds a row takes.
    arguments
        Of the kernel, after the first row and the one after the last.
    """
    # The processors that this process may use, or the environment variable NUMBA_NUM_THREADS.
    processors: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    threads = min(processors, rows, int(rows * row_ns / _LEAST_NS))
    if threads < 2:
        kernel(0, rows, *arguments)
        return
    edges = np.linspace(0, rows, min(rows, threads * _CHUNKS) + 1).astype(np.int64).tolist()
    try:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(lambda start, stop: kernel(start, stop, *arguments), edges, edges[1:]))
    except RuntimeError:  # no thread can be started: too many of them, or Python is about to exit
        kernel(0, rows, *arguments)
