"""Batching: what requests ask for at the same time is done together, on threads of its own."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from threading import Condition, Thread
from typing import Any

from graspcast.service.replies import RefusedError

__all__ = ["Batcher", "Run"]

Run = Callable[[Sequence[Any]], Sequence[Any]]
"""Does a batch of items: a result, or an exception, for each of them in order."""

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class _Job:
    kind: str
    item: Any
    future: asyncio.Future[Any]
    loop: asyncio.AbstractEventLoop


class Batcher:
    """Collects what requests wait for, and does it in batches on threads of its own.

    While a batch is done, the next one gathers, so that batches grow with the load by themselves.

    Parameters
    ----------
    runs
        Name of each kind of work to what does it.
    prepare
        Done once on the first thread before any batch.
    batch
        Most items that are done at once.
    waiting
        Most items that wait; further ones are refused with status 503.
    threads
        How many batches are done side by side.
    """

    def __init__(
        self,
        runs: Mapping[str, Run],
        *,
        prepare: Callable[[], None] = lambda: None,
        batch: int = 32,
        waiting: int = 512,
        threads: int = 1,
    ):
        self._runs, self._prepare = dict(runs), prepare
        self._batch, self._waiting = batch, waiting
        self._jobs: deque[_Job] = deque()
        self._changed = Condition()
        self._closed = self._ready = False
        self._threads = [
            Thread(target=self._work, name=f"graspcast-batches-{i}", daemon=True)
            for i in range(threads)
        ]

    @property
    def ready(self) -> bool:
        """Whether the preparation is done, so that nothing waits for it."""
        return self._ready and not self._closed

    @property
    def waiting(self) -> int:
        """How many items wait."""
        return len(self._jobs)

    def start(self) -> None:
        """Start the threads."""
        for thread in self._threads:
            thread.start()

    async def do(self, kind: str, item: Any) -> Any:
        """Have one item done, in a batch with others.

        Raises
        ------
        RefusedError
            With status 503 if too many items wait, or the service is stopping.
        ValueError
            For an unknown kind.
        Exception
            What the work gave for this item in place of a result.
        """
        if kind not in self._runs:
            raise ValueError(f"no kind of work is called {kind!r}")
        loop = asyncio.get_running_loop()
        job = _Job(kind, item, loop.create_future(), loop)
        with self._changed:
            if self._closed:
                raise RefusedError(503, "the service is stopping", headers=(("Retry-After", "5"),))
            if len(self._jobs) >= self._waiting:
                raise RefusedError(
                    503,
                    f"{self._waiting} requests are waiting; try again later",
                    headers=(("Retry-After", "1"),),
                )
            self._jobs.append(job)
            self._changed.notify()
        return await job.future

    def close(self) -> None:
        """Take nothing more, finish what waits, and end the threads."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        for thread in self._threads:
            if thread.ident is not None:
                thread.join()

    def _work(self) -> None:
        if self._threads[0].name == _own_name():
            self._prepare_once()
        else:
            with self._changed:
                self._changed.wait_for(lambda: self._ready)
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._jobs or self._closed)
                taken = [self._jobs.popleft() for _ in range(min(self._batch, len(self._jobs)))]
            if not taken:
                return
            for kind, run in self._runs.items():
                if jobs := [job for job in taken if job.kind == kind]:
                    _finish(jobs, _results(run, [job.item for job in jobs]))

    def _prepare_once(self) -> None:
        try:
            self._prepare()
        except Exception:
            _logger.exception("the preparation failed; the first verdicts take longer")
        with self._changed:
            self._ready = True
            self._changed.notify_all()


def _own_name() -> str:
    from threading import current_thread

    return current_thread().name


def _results(run: Run, items: Sequence[Any]) -> Sequence[Any]:
    """Do a batch; where that fails, each item alone, so that one spoils no other."""
    try:
        return run(items)
    except Exception as error:
        if len(items) == 1:
            return [error]
        _logger.exception("a batch failed; its items are done one by one")
        return [result for item in items for result in _results(run, [item])]


def _finish(jobs: Sequence[_Job], results: Sequence[Any]) -> None:
    """Hand the results over to the event loop, all at once."""

    def deliver() -> None:
        for job, result in zip(jobs, results, strict=True):
            if job.future.done():
                continue
            if isinstance(result, Exception):
                job.future.set_exception(result)
            else:
                job.future.set_result(result)

    try:
        jobs[0].loop.call_soon_threadsafe(deliver)
    except RuntimeError:
        # The loop has ended: the service was stopped the hard way.
        _logger.warning("%d answers were ready after the service had stopped", len(jobs))
