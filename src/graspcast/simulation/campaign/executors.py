"""Where a campaign's trials are computed: processes of this machine, or a Ray cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait as wait_for
from typing import Any, Protocol, runtime_checkable

from graspcast.errors import ExtraMissingError, InputError, WorkerLostError
from graspcast.simulation.campaign.jobs import Batch, TrialSetup, run_batch
from graspcast.simulation.trial.trial import Outcome

__all__ = ["Executor", "LocalExecutor", "RayExecutor", "usable_cores"]

Pairs = Mapping[tuple[str, str], TrialSetup]
Done = tuple[Batch, list[Outcome]]


@runtime_checkable
class Executor(Protocol):
    """Computes chunks of trials, in any order."""

    def run(self, pairs: Pairs, chunks: Sequence[Batch]) -> Generator[Done, None, None]:
        """Yield each chunk with its outcomes as soon as they are known.

        Raises
        ------
        WorkerLostError
            If a worker died and nobody could take its place.
        """
        ...


def usable_cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class LocalExecutor:
    """Worker processes on this machine.

    Each is started afresh (never forked, which MuJoCo's and polars' threads would not survive), so
    a script that uses more than one must have its ``if __name__ == "__main__":``.

    Parameters
    ----------
    workers
        How many; all usable cores if left out. One computes in this process.

    Raises
    ------
    InputError
        For fewer than one.
    """

    def __init__(self, workers: int | None = None):
        self.workers = usable_cores() if workers is None else workers
        if self.workers < 1:
            raise InputError(f"--workers is {workers}; give at least 1")

    def run(self, pairs: Pairs, chunks: Sequence[Batch]) -> Generator[Done, None, None]:
        """Yield each chunk with its outcomes.

        Raises
        ------
        WorkerLostError
            If a worker died.
        """
        if self.workers == 1:
            for chunk in chunks:
                yield chunk, run_batch(pairs[chunk.pair], chunk)
            return
        pool = ProcessPoolExecutor(
            self.workers,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_start_worker,
            initargs=(pairs,),
        )
        try:
            yield from self._through(pool, chunks)
        except BrokenProcessPool as error:
            raise WorkerLostError(
                "a worker process died: it was killed, or the machine is short of memory, or the "
                "calling script lacks its `if __name__ == '__main__':`"
            ) from error
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    def _through(
        self, pool: ProcessPoolExecutor, chunks: Sequence[Batch]
    ) -> Generator[Done, None, None]:
        waiting = iter(chunks)
        running: dict[Future[list[Outcome]], Batch] = {}
        while True:
            # Two chunks ahead keep a worker busy; more would only be memory.
            for chunk in _take(waiting, 2 * self.workers - len(running)):
                running[pool.submit(_run_in_worker, chunk)] = chunk
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future.result()


_pairs: Pairs = {}


def _start_worker(pairs: Pairs) -> None:
    global _pairs
    _pairs = pairs
    # Ctrl-C is for the parent, which then ends its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    """End this process when its parent is gone, which a killed one cannot ask for."""
    wait_for([sentinel])
    os._exit(1)


def _run_in_worker(chunk: Batch) -> list[Outcome]:
    return run_batch(_pairs[chunk.pair], chunk)


class RayExecutor:
    """Workers on a Ray cluster; what a lost node was computing is computed elsewhere.

    The nodes need graspcast of the same version, and Ray. A gripper from an MJCF file must be at
    the same path on each.

    Parameters
    ----------
    address
        The cluster's address; the one this process is connected to, or else the one that Ray finds,
        if left out.
    ahead
        How many chunks are handed out at a time, at most; twice the cluster's cores if left out.

    Raises
    ------
    ExtraMissingError
        If Ray is not installed.
    """

    def __init__(self, address: str | None = None, ahead: int | None = None):
        try:
            import ray
        except ImportError as error:
            raise ExtraMissingError("ray", "ray") from error
        self._ray = ray
        self.address, self.ahead = address, ahead

    def run(self, pairs: Pairs, chunks: Sequence[Batch]) -> Generator[Done, None, None]:
        """Yield each chunk with its outcomes.

        Raises
        ------
        WorkerLostError
            If the cluster cannot be reached, or is lost as a whole.
        InputError
            If a trial failed.
        """
        ray = self._ray
        if not ray.is_initialized():
            try:
                ray.init(address=self.address or "auto", log_to_driver=False)
            except (ConnectionError, RuntimeError, ValueError) as error:
                raise WorkerLostError(f"no Ray cluster could be reached: {error}") from error
        # A chunk has no effect but its outcome, so running it again is always right.
        remote = ray.remote(num_cpus=1, max_retries=-1)(run_batch)
        stored = {name: ray.put(pair) for name, pair in pairs.items()}
        waiting = iter(chunks)
        running: dict[Any, Batch] = {}
        while True:
            ahead = self.ahead or 2 * max(1, int(ray.cluster_resources().get("CPU", 1)))
            for chunk in _take(waiting, ahead - len(running)):
                running[remote.remote(stored[chunk.pair], chunk)] = chunk
            if not running:
                return
            done, _ = ray.wait(list(running), num_returns=1)
            for reference in done:
                try:
                    outcomes = ray.get(reference)
                except ray.exceptions.RayTaskError as error:
                    raise InputError(str(error.cause)) from error
                except ray.exceptions.RayError as error:
                    raise WorkerLostError(f"the Ray cluster was lost: {error}") from error
                yield running.pop(reference), outcomes


def _take(chunks: Iterator[Batch], count: int) -> list[Batch]:
    return [chunk for _, chunk in zip(range(count), chunks, strict=False)]
