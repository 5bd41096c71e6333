"""Executor of a campaign on a Ray cluster: every batch comes back, whatever happens to a node."""

from __future__ import annotations

import logging
import os
import pickle
import socket
import tempfile
import time
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from runpy import run_path
from typing import Any

from graspcast._version import __version__
from graspcast.errors import InputError, MismatchError, WorkerLostError
from graspcast.io.extras import require
from graspcast.io.wording import counted
from graspcast.simulation.campaign import on_node
from graspcast.simulation.campaign.executors import Done, Setups
from graspcast.simulation.campaign.jobs import Batch
from graspcast.simulation.campaign.requests import SetupKey
from graspcast.simulation.engine import mujoco

__all__ = ["RayExecutor"]

_log = logging.getLogger(__name__)

_CONNECT_S = 10.0
"""Time for the cluster to answer, seconds. Ray itself tries for minutes."""

_LOOK_S = 2.0
"""Time between two looks at which nodes there are, seconds."""

_ANSWER_S, _HEAD_S = 2.0, 30.0
"""How long the head node may take to answer, and be silent, seconds; Ray gives up after 60."""

_CHECK_S = 60.0
"""Time for a node to say which versions it has, seconds; it may have to load them from a disk."""

_AGAIN_S, _STILL_S = 60.0, 300.0
"""Times until a warning is given again, and until one says that nothing comes back, seconds."""

_RETRIES = 20
"""How often a batch is run again when its worker dies: a trial that kills workers must end."""


_EXPECTED = {"graspcast": __version__, "mujoco": mujoco.__version__}
"""Versions that every node must have: they are part of a campaign's configuration."""


class RayExecutor:
    """Workers on a Ray cluster; batches of a lost node are run again on another.

    Every node needs Ray and the same versions of graspcast and MuJoCo, which is checked. The MJCF
    file of a custom gripper must have the same path on every node. While no node is left that runs
    trials, the executor waits for one, and logs a warning that says so.

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
        require("ray")
        import ray

        self._ray = ray
        self.address, self.ahead = address, ahead

    def run(self, setups: Setups, batches: Iterable[Batch]) -> Generator[Done, None, None]:
        """Yield each batch with its outcomes.

        Raises
        ------
        WorkerLostError
            If the cluster cannot be reached, is lost as a whole, or a batch kills every worker.
        MismatchError
            If a node lacks graspcast, or has another version of it or of MuJoCo.
        InputError
            If a trial failed.
        """
        ray = self._ray
        mine = not ray.is_initialized()
        if mine:
            _connect(ray, self.address)
        try:
            run = _Run(ray, self.ahead)
            try:
                run.check_nodes()
                yield from run.results(setups, batches)
            finally:
                run.end()
        except ray.exceptions.RayError as error:
            raise WorkerLostError(f"the Ray cluster was lost: {_first_line(error)}") from error
        finally:
            if mine:
                ray.shutdown()


def _connect(ray: Any, address: str | None) -> None:
    """Connect this process to the cluster."""
    address = address or "auto"
    _check_reachable(address)
    try:
        ray.init(address=address, log_to_driver=False, logging_level=logging.WARNING)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise WorkerLostError(
            f"the Ray cluster could not be used: {' '.join(str(error).split())}",
            parameters=("address",),
        ) from error


def _check_reachable(address: str) -> None:
    """Raise if nothing answers at the address; Ray would try for minutes, and say nothing."""
    named = address if address != "auto" else os.environ.get("RAY_ADDRESS", "") or _last_started()
    named = named.removeprefix("ray://")
    host, _, port = named.rpartition(":")
    if not host or not port.isdecimal():
        return  # Ray itself says what is wrong with it
    if why := _unreachable(named, _CONNECT_S):
        raise WorkerLostError(
            f"no Ray cluster answers at {named} ({why}): "
            "its head node does not run, or its port is not open to this machine",
            parameters=("address",),
        )


def _unreachable(address: str, seconds: float) -> str:
    """Return why no connection can be made to ``host:port``; empty if one can."""
    host, _, port = address.rpartition(":")
    try:
        with socket.create_connection((host, int(port)), seconds):
            return ""
    except (OSError, OverflowError) as error:
        return str(getattr(error, "strerror", "") or error)


def _last_started() -> str:
    """Return the address of the cluster that was last started on this machine, if any."""
    folder = os.environ.get("RAY_TMPDIR") or tempfile.gettempdir()
    with suppress(OSError, UnicodeDecodeError):
        return (Path(folder) / "ray" / "ray_current_cluster").read_text().strip()
    return ""


class _Run:
    """A run on a cluster: what was submitted, and what the nodes need."""

    def __init__(self, ray: Any, ahead: int | None) -> None:
        self._ray, self._most = ray, ahead
        # Defined anew, in no module that could be imported, so Ray sends code instead of a name.
        self._on_node = run_path(on_node.__file__, run_name="graspcast_on_node")
        self._remote = ray.remote(num_cpus=1, max_retries=_RETRIES)(self._on_node["run"])
        self._running: dict[Any, Batch] = {}
        self._setup: tuple[SetupKey, Any] | None = None
        self._nodes = _Nodes(ray)

    def check_nodes(self) -> None:
        """Raise if a node that could run trials has other versions."""
        ray = self._ray
        on = ray.util.scheduling_strategies.NodeAffinitySchedulingStrategy
        look = ray.remote(num_cpus=0, max_retries=0)(self._on_node["look"])
        asked = {
            look.options(scheduling_strategy=on(node["NodeID"], soft=False)).remote(
                _EXPECTED
            ): node["NodeManagerAddress"]
            for node in self._nodes.usable()
        }
        if not asked:
            return
        answered, silent = ray.wait(list(asked), num_returns=len(asked), timeout=_CHECK_S)
        problems = []
        for reference in answered:
            with suppress(ray.exceptions.RayError):  # of a node that was lost meanwhile
                if different := ray.get(reference):
                    problems.append((asked[reference], different))
        if problems:
            raise _mismatch(problems)
        if silent:
            _log.warning(
                "%s of the Ray cluster did not say within %.0f s which versions they have (%s); "
                "they are checked again before they run trials",
                counted(len(silent), "node"),
                _CHECK_S,
                ", ".join(asked[reference] for reference in silent[:5]),
            )

    def results(self, setups: Setups, batches: Iterable[Batch]) -> Iterator[Done]:
        ray, waiting = self._ray, iter(batches)
        while True:
            ahead = self._most or 2 * max(1, self._nodes.cores)
            for batch in islice(waiting, max(0, ahead - len(self._running))):
                setup = self._stored(setups, batch.setup)
                self._running[self._remote.remote(_EXPECTED, setup, pickle.dumps(batch))] = batch
            if not self._running:
                return
            done, _ = ray.wait(list(self._running), num_returns=1, timeout=_LOOK_S)
            self._nodes.watch(progressed=bool(done))
            for reference in done:
                outcomes = self._outcomes(reference)
                yield self._running.pop(reference), outcomes

    def _stored(self, setups: Setups, key: SetupKey) -> Any:
        # Stored once for the batches of a setup, which follow each other; Ray frees it after them.
        if self._setup is None or self._setup[0] != key:
            self._setup = key, self._ray.put(pickle.dumps(setups[key]))
        return self._setup[1]

    def _outcomes(self, reference: Any) -> Any:
        exceptions = self._ray.exceptions
        try:
            node, outcomes, different = self._ray.get(reference)
        except exceptions.RayTaskError as error:
            raise InputError(f"{_first_line(error.cause)} (on the node {error.ip})") from error
        except (exceptions.WorkerCrashedError, exceptions.OutOfMemoryError) as error:
            name, gripper, _ = self._running[reference].setup
            raise WorkerLostError(
                f"{_RETRIES + 1} workers died at the same trials of {name} by {gripper}: "
                f"{_first_line(error)}"
            ) from error
        if different:
            raise _mismatch([(node, different)])
        return outcomes

    def end(self) -> None:
        """Cancel what was submitted."""
        for reference in self._running:
            with suppress(Exception):  # the cluster may be gone
                self._ray.cancel(reference, force=True)


class _Nodes:
    """The nodes of a cluster that run trials, and warnings while nothing comes back."""

    def __init__(self, ray: Any) -> None:
        self._ray = ray
        self.cores = 0
        self._looked = self._worked = time.monotonic()
        self._next_s = 0.0
        self._lost: float | None = None
        # A client of a cluster (ray://) may not see the head node itself.
        head = str(ray.get_runtime_context().gcs_address)
        self._head = "" if _unreachable(head, _ANSWER_S) else head
        self._answered = time.monotonic()
        self.usable()

    def usable(self) -> list[dict[str, Any]]:
        """Return the nodes that run trials."""
        found = [n for n in self._ray.nodes() if n["Alive"] and n["Resources"].get("CPU", 0) >= 1]
        self.cores = sum(int(node["Resources"]["CPU"]) for node in found)
        return found

    def watch(self, *, progressed: bool) -> None:
        """Look which nodes there are, now and then, and warn if the run stands still."""
        now = time.monotonic()
        if progressed:
            self._worked = now
        if now - self._looked < _LOOK_S:
            return
        self._looked = now
        if not self._head_answers():
            return
        if nodes := self.usable():
            self._found(now, len(nodes))
        elif self._lost is None:
            self._lost, self._next_s = now, 0.0
        if self._lost is not None and (waited := now - self._lost) >= self._next_s:
            self._next_s = max(_AGAIN_S, 2 * waited)
            _log.warning(
                "no node of the Ray cluster runs trials%s: the campaign waits for one; "
                "start one, or interrupt it and resume later",
                f", for {waited:.0f} s" if waited >= 1 else "",
            )

    def _head_answers(self) -> bool:
        """Raise if the head node has been silent for long: Ray would end the process without it."""
        why = _unreachable(self._head, _ANSWER_S) if self._head else ""
        now = time.monotonic()
        if not why:
            self._answered = now
        elif (silent := now - self._answered) > _HEAD_S:
            raise WorkerLostError(
                f"the head node of the Ray cluster, {self._head}, was lost ({why}; it has not "
                f"answered for {silent:.0f} s)"
            )
        return not why

    def _found(self, now: float, count: int) -> None:
        """Say that nodes are back, or that there are some and yet nothing comes back."""
        if self._lost is not None:
            _log.warning(
                "after %.0f s the Ray cluster has %s again",
                now - self._lost,
                counted(count, "node"),
            )
            self._lost, self._worked, self._next_s = None, now, 0.0
        idle = now - self._worked
        if idle < _STILL_S:
            self._next_s = _STILL_S
        elif idle >= self._next_s:
            self._next_s = 2 * idle
            _log.warning(
                "no trials have come back for %.0f s, though the Ray cluster has %s with %s; other "
                "jobs may hold them (`ray status` shows it)",
                idle,
                counted(count, "node"),
                counted(self.cores, "core"),
            )


def _mismatch(problems: Sequence[tuple[str, Mapping[str, str]]]) -> MismatchError:
    """Return the error for nodes with other versions; at most five are named."""
    told = []
    for node, different in sorted(problems, key=str)[:5]:
        had = (
            f"no {package}" if not found else f"{package} {found} (here {_EXPECTED[package]})"
            for package, found in different.items()
        )
        told.append(f"the node {node} has {' and '.join(had)}")
    if len(problems) > len(told):
        told.append(f"{len(problems) - len(told)} more nodes differ too")
    pinned = f"'graspcast[ray]=={__version__}' 'mujoco=={mujoco.__version__}'"
    return MismatchError(
        f"{'; '.join(told)}: outcomes of different versions cannot be mixed; install the same on "
        f"every node, into the Python that runs Ray there: pip install {pinned}"
    )


def _first_line(error: object) -> str:
    return next(iter(str(error).strip().splitlines()), type(error).__name__)
