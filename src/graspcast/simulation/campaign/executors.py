"""Executors of a campaign: what runs its trials, here processes on this machine."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections import deque
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import islice
from multiprocessing.connection import wait
from typing import Any, Protocol, runtime_checkable

from graspcast.errors import InputError, WorkerLostError
from graspcast.simulation.campaign.jobs import Batch, TrialSetup, run_batch
from graspcast.simulation.campaign.requests import SetupKey
from graspcast.simulation.trial.trial import Outcome

__all__ = ["Done", "Executor", "LocalExecutor", "Setups", "usable_cores"]

Setups = Mapping[SetupKey, TrialSetup]
"""Trial setups by (object, gripper, grasp)."""

Done = tuple[Batch, list[Outcome]]
"""A batch with its outcomes, in its order."""

_LEAVING_S = 5.0
"""Time for a process whose pipe is closed to end, seconds."""


@runtime_checkable
class Executor(Protocol):
    """Runs batches of trials, in any order."""

    def run(self, setups: Setups, batches: Sequence[Batch]) -> Generator[Done, None, None]:
        """Yield each batch with its outcomes as soon as they are computed.

        Raises
        ------
        WorkerLostError
            If a worker died and its batch could not be run elsewhere.
        """
        ...


def usable_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class LocalExecutor:
    """Worker processes on this machine.

    Processes are spawned, not forked, because the threads of MuJoCo and polars do not survive a
    fork. A script that uses several workers therefore needs ``if __name__ == "__main__":``.

    Parameters
    ----------
    workers
        Number of processes; all usable cores if None. With 1, the trials run in this process.

    Raises
    ------
    InputError
        If ``workers`` is below 1.
    """

    def __init__(self, workers: int | None = None):
        self.workers = usable_cores() if workers is None else workers
        if self.workers < 1:
            raise InputError(
                f"workers is {workers}; it must be at least 1", parameters=("workers",)
            )

    def run(self, setups: Setups, batches: Sequence[Batch]) -> Generator[Done, None, None]:
        """Yield each batch with its outcomes.

        Raises
        ------
        WorkerLostError
            If a worker died.
        """
        if self.workers == 1:
            for batch in batches:
                yield batch, run_batch(setups[batch.setup], batch)
            return
        workers = _Workers(min(self.workers, len(batches)))
        try:
            workers.start(setups)
            yield from workers.results(batches)
        finally:
            workers.end()


_AHEAD = 2
"""Batches that a worker holds: two keep it busy; more would only use memory."""


class _Worker:
    """A worker process, the pipe to it, and the batches that it was sent, oldest first."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_work, args=(theirs,), daemon=True)
        self.running: deque[Batch] = deque()
        try:
            # What is passed here must be small: `start` writes it to a pipe whose other end is open
            # in this process too, so that it would wait for ever for a worker that is dead.
            with _without_interrupts(), _with_few_arguments():
                self.process.start()
        except OSError as error:
            self.pipe.close()
            raise WorkerLostError(
                f"a worker process could not be started ({error.strerror or error})",
                parameters=("workers",),
            ) from error
        finally:
            # With the only other end in the worker, its death ends every wait for the pipe.
            theirs.close()

    def send(self, message: bytes) -> None:
        try:
            self.pipe.send_bytes(message)
        except OSError as error:
            raise self.lost() from error

    def receive(self) -> Done:
        """Return the oldest batch with its outcomes."""
        try:
            answer = self.pipe.recv()
        except (EOFError, OSError, pickle.UnpicklingError) as error:
            raise self.lost() from error
        if isinstance(answer, Exception):
            raise answer
        return self.running.popleft(), answer

    def lost(self) -> WorkerLostError:
        self.process.join(_LEAVING_S)
        code = self.process.exitcode
        if code is not None and code < 0:
            how = f"it was killed by signal {-code}, perhaps because memory ran out"
        else:
            how = (
                f"it ended with exit code {code}; its error is above, or the calling script lacks "
                "`if __name__ == '__main__':`"
            )
        return WorkerLostError(f"a worker process died: {how}")

    def end(self) -> None:
        self.pipe.close()
        self.process.kill()  # a worker writes nothing
        self.process.join()
        self.process.close()


class _Workers:
    """Worker processes, each with a pipe of its own; there are no locks that one could die with."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._workers: list[_Worker] = []

    def start(self, setups: Setups) -> None:
        for _ in range(self._count):
            self._workers.append(_Worker())
        message = pickle.dumps(setups)
        for worker in self._workers:
            worker.send(message)

    def results(self, batches: Sequence[Batch]) -> Generator[Done, None, None]:
        waiting = iter(batches)
        for _ in range(_AHEAD):
            for worker in self._workers:
                self._submit(worker, waiting)
        while busy := {worker.pipe: worker for worker in self._workers if worker.running}:
            for pipe in wait(list(busy)):
                worker = busy[pipe]  # type: ignore[index]
                done = worker.receive()
                self._submit(worker, waiting)
                yield done

    def _submit(self, worker: _Worker, waiting: Iterator[Batch]) -> None:
        for batch in islice(waiting, 1):
            worker.running.append(batch)
            worker.send(pickle.dumps(batch))

    def end(self) -> None:
        for worker in self._workers:
            worker.end()


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Block Ctrl-C in a process that is started: its parent handles it, and stops its workers."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # when `start` starts it, it unblocks Ctrl-C again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_MOST_ARGUMENTS = 16_384
"""Longest command line that workers are given, bytes; pipes hold 64 KiB on Linux."""


@contextmanager
def _with_few_arguments() -> Iterator[None]:
    """Hide a long command line from a worker that is started; it would be sent through a pipe."""
    before = sys.argv
    if sum(map(len, before)) > _MOST_ARGUMENTS:
        sys.argv = before[:1]
    try:
        yield
    finally:
        sys.argv = before


def _work(pipe: Any) -> None:  # pragma: no cover - in processes that are killed in the end
    """Run batches until the pipe closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=_exit_with, args=(parent.sentinel,), daemon=True).start()
    with suppress(EOFError, OSError):  # the parent is gone
        setups: Setups = pickle.loads(pipe.recv_bytes())
        while True:
            batch: Batch = pickle.loads(pipe.recv_bytes())
            try:
                answer: object = run_batch(setups[batch.setup], batch)
            except Exception as error:
                answer = error
            pipe.send(answer)


def _exit_with(sentinel: int) -> None:  # pragma: no cover - likewise
    """Exit when the parent process ends; a killed parent cannot stop its workers."""
    wait([sentinel])
    os._exit(1)
