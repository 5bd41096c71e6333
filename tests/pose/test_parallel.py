"""Loops over rows: every row once, on one thread or several, whatever the process does besides."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numba
import numpy as np
import pytest

import graspcast
from graspcast.pose.parallel import over_rows

MILLISECOND = 1e6


def seen(rows: int, row_ns: float) -> tuple[np.ndarray, set[int]]:
    """How often each row was computed, and the threads that took part."""
    count, threads = np.zeros(rows, int), set()

    def kernel(start: int, stop: int, count: np.ndarray) -> None:
        count[start:stop] += 1
        threads.add(threading.get_ident())

    over_rows(kernel, rows, row_ns, count)
    return count, threads


@pytest.fixture(autouse=True)
def _four_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", 4)


@pytest.mark.parametrize("rows", [0, 1, 2, 5, 16, 17, 1000])
@pytest.mark.parametrize("row_ns", [0.0, 1.0, MILLISECOND, 100 * MILLISECOND])
def test_every_row_is_computed_once(rows: int, row_ns: float) -> None:
    count, _ = seen(rows, row_ns)
    assert (count == 1).all()


@pytest.mark.parametrize(("rows", "row_ns"), [(1, 100 * MILLISECOND), (10, MILLISECOND / 10)])
def test_little_work_stays_on_the_calling_thread(rows: int, row_ns: float) -> None:
    assert seen(rows, row_ns)[1] == {threading.get_ident()}


def test_much_work_is_done_by_others_and_none_of_them_stays() -> None:
    before = threading.active_count()
    _, threads = seen(1000, MILLISECOND)
    assert threading.get_ident() not in threads
    assert threading.active_count() == before


def test_where_no_thread_starts_the_calling_one_does_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(self: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refused)
    out = np.zeros(100)

    def kernel(start: int, stop: int, out: np.ndarray) -> None:
        out[start:stop] = np.arange(start, stop)

    over_rows(kernel, 100, MILLISECOND, out)
    np.testing.assert_array_equal(out, np.arange(100))


def test_calls_from_many_threads_at_once() -> None:
    with ThreadPoolExecutor(8) as pool:
        for count, _ in pool.map(lambda _: seen(200, MILLISECOND), range(40)):
            assert (count == 1).all()


def test_an_error_of_the_kernel_is_raised() -> None:
    def kernel(start: int, stop: int) -> None:
        if stop == 100:
            raise MemoryError

    with pytest.raises(MemoryError):
        over_rows(kernel, 100, MILLISECOND)


def test_no_module_uses_the_threads_of_numba() -> None:
    """They abort the process when two threads call, or after a fork."""
    for path in Path(graspcast.__file__).parent.rglob("*.py"):
        text = path.read_text()
        assert "prange" not in text, path
        assert "parallel=True" not in text or path.name == "parallel.py", path
