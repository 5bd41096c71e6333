"""Executors of a campaign: processes on this machine, or a Ray cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Generator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from multiprocessing.connection import wait as wait_for
from typing import Any, Protocol, runtime_checkable

from graspcast.errors import ExtraMissingError, InputError, WorkerLostError
from graspcast.simulation.campaign.jobs import Batch, TrialSetup, run_batch
from graspcast.simulation.trial.trial import Outcome

__all__ = ["Executor", "LocalExecutor", "RayExecutor", "usable_cores"]

Setups = Mapping[tuple[str, str], TrialSetup]
Done = tuple[Batch, list[Outcome]]


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
        pool = ProcessPoolExecutor(
            self.workers,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_start_worker,
            initargs=(setups,),
        )
        try:
            yield from self._results(pool, batches)
        except BrokenProcessPool as error:
            raise WorkerLostError(
                "a worker process died: it was killed, or memory ran out, or the calling script "
                "lacks `if __name__ == '__main__':`"
            ) from error
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    def _results(
        self, pool: ProcessPoolExecutor, batches: Sequence[Batch]
    ) -> Generator[Done, None, None]:
        waiting = iter(batches)
        running: dict[Future[list[Outcome]], Batch] = {}
        while True:
            # Two batches per worker keep it busy; more would only use memory.
            for batch in islice(waiting, 2 * self.workers - len(running)):
                running[pool.submit(_run_in_worker, batch)] = batch
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future.result()


_setups: Setups = {}


def _start_worker(setups: Setups) -> None:
    global _setups
    _setups = setups
    # The parent handles Ctrl-C and stops its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=_exit_with, args=(parent.sentinel,), daemon=True).start()


def _exit_with(sentinel: int) -> None:
    """Exit when the parent process ends; a killed parent cannot stop its workers."""
    wait_for([sentinel])
    os._exit(1)


def _run_in_worker(batch: Batch) -> list[Outcome]:
    return run_batch(_setups[batch.setup], batch)


class RayExecutor:
    """Workers on a Ray cluster; batches of a lost node are run again on another.

    Every node needs Ray and the same version of graspcast. The MJCF file of a custom gripper must
    have the same path on every node.

    Parameters
    ----------
    address
        Address of the cluster. If None: the cluster that this process is connected to, or else the
        one that Ray finds.
    ahead
        Largest number of batches submitted at a time; twice the cluster's cores if None.

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

    def run(self, setups: Setups, batches: Sequence[Batch]) -> Generator[Done, None, None]:
        """Yield each batch with its outcomes.

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
                raise WorkerLostError(
                    f"no Ray cluster could be reached: {error}", parameters=("address",)
                ) from error
        # A batch has no side effects, so it can be run again.
        remote = ray.remote(num_cpus=1, max_retries=-1)(run_batch)
        stored = {key: ray.put(setup) for key, setup in setups.items()}
        waiting = iter(batches)
        running: dict[Any, Batch] = {}
        while True:
            ahead = self.ahead or 2 * max(1, int(ray.cluster_resources().get("CPU", 1)))
            for batch in islice(waiting, max(0, ahead - len(running))):
                running[remote.remote(stored[batch.setup], batch)] = batch
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
