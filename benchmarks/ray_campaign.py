"""A campaign on a Ray cluster of two nodes against local workers, and what kills of nodes cost.

    python benchmarks/ray_campaign.py [--trials 800] [--rounds 3]

Linux only; takes about three minutes on two cores. It starts a cluster as a user does (``ray start
--head``, and ``ray start --address`` for the second node, of one core each, on the loopback
interface), and ends what it started. In turn it runs one campaign in one process, by two local
workers, and on the cluster, and prints medians over the rounds:

- trials/s from the first batch to the last, and the start-up until the first batch;
- the CPU time of the driver (the process that submits and stores), with batches as small campaigns
  have them and as those of millions of trials do, and how many trials/s it gets through if the
  trials themselves take no time;
- what is sent to the nodes and back.

Then the second node is killed (SIGKILL to all its processes) in mid-run, and after that the driver,
which is started again. Every trial must have one outcome, the same bit for bit as without a
cluster; if not, the exit code is 1. The last lines can be pasted into ``docs/cluster.md``.
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import shutil
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl

from campaign_driver import planned
from graspcast.simulation.campaign import batches
from graspcast.simulation.campaign.campaign import run_campaign
from graspcast.simulation.campaign.executors import Executor, LocalExecutor
from graspcast.simulation.campaign.jobs import TrialSetup, load_setups, run_batch
from graspcast.simulation.campaign.requests import SetupKey, TrialRequests
from graspcast.simulation.campaign.store import Store
from graspcast.simulation.grasps.table import read_grasps
from graspcast.simulation.trial.trial import Outcome
from kills import TOKEN, family

ADDRESS = "127.0.0.1"
STARTS = 4
LONGEST_S = 300.0
INSTANT_TRIALS = 100_000


def campaign(count: int) -> tuple[TrialRequests, dict[SetupKey, TrialSetup]]:
    """Return trials of the tomato soup can by the parallel gripper, off by a centimetre and 6°."""
    requests = planned(count)
    return requests, load_setups(requests, read_grasps())


class Instant(TrialSetup):
    """A setup whose trials take no time: what is left is the work of the driver and of Ray."""

    def runner(self) -> Any:
        outcome = Outcome(True, "held", 0.001, 2.5, 0.02, 900)
        return SimpleNamespace(digest="0" * 64, run=lambda *_, **__: outcome)


def drive(out: Path, kind: str, count: int, address: str) -> None:
    """Run the campaign in this process, and print its figures as JSON."""
    requests, setups = campaign(count)
    if kind == "instant":
        import ray_campaign  # the nodes import the class by this name

        batches._SMALLEST = batches._LARGEST
        setups = {key: ray_campaign.Instant(**vars(setup)) for key, setup in setups.items()}
    began, cpu_0 = time.perf_counter(), time.process_time()
    marks: list[tuple[float, float, int]] = []

    def note(share: float, _: str) -> None:
        marks.append((time.perf_counter() - began, time.process_time(), round(share * count)))

    run_campaign(requests, setups, out, executor=executor(kind, address), progress=note)
    stored, first = marks[0], marks[1]
    # With several workers the first batches come back together: the rate is that of the rest.
    start, end = marks[1 + (kind != "one")], marks[-1]
    done, seconds = end[2] - start[2], end[0] - start[0]
    figures = {
        "start_s": first[0],
        "rate": done / seconds,
        "driver_cpu_ms": 1e3 * (end[1] - start[1]) / done,
        "whole_s": time.perf_counter() - began,
        "before": stored[2],
        "cpu_s": time.process_time() - cpu_0,
    }
    print(json.dumps(figures))


def executor(kind: str, address: str) -> Executor:
    """Return what runs the trials."""
    if kind in ("ray", "instant"):
        from graspcast.simulation.campaign.ray_executor import RayExecutor

        return RayExecutor(address)
    return LocalExecutor(1 if kind == "one" else 2)


class Driver:
    """A process that runs the campaign."""

    def __init__(self, out: Path, kind: str, count: int, address: str):
        self.out, self.count = out, count
        command = [
            sys.executable,
            str(Path(__file__).resolve()),
            "--drive",
            kind,
            "--out",
            str(out),
        ]
        command += ["--trials", str(count), "--address", address]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)

    def wait_for(self, share: float) -> int:
        """Wait until a share of the trials is stored; return how many are."""
        end = time.monotonic() + LONGEST_S
        while time.monotonic() < end and self.process.poll() is None:
            if (stored := kept(self.out)) >= share * self.count:
                return stored
            time.sleep(0.05)
        raise SystemExit("the campaign ended, or stood still, before it could be disturbed")

    def figures(self) -> dict[str, float]:
        """Wait for the end, and return the figures."""
        said, _ = self.process.communicate(timeout=LONGEST_S)
        lines = [line for line in said.splitlines() if line.startswith("{")]
        if self.process.returncode or not lines:
            raise SystemExit(f"a campaign failed with exit code {self.process.returncode}")
        return dict(json.loads(lines[-1]))


def kept(out: Path) -> int:
    """Return how many trials are stored while a campaign runs."""
    total = 0
    for path in (out / "shards").glob("[!.]*.parquet"):
        with suppress(OSError, pl.exceptions.PolarsError):
            total += pl.scan_parquet(path).select(pl.len()).collect().item()
    return total


class Cluster:
    """Two Ray nodes of one core each; every process of a node carries the node's token."""

    def __init__(self, folder: Path):
        self.folder, self.address = folder, f"{ADDRESS}:{free_port()}"
        self.nodes: list[str] = []

    def start(self) -> float:
        """Start a node, the head first; return the seconds that it took."""
        head = not self.nodes
        options = ["--num-cpus=1", "--disable-usage-stats", "--object-store-memory=200000000"]
        if head:
            # Ray's sockets lie in this folder, and their paths must be short.
            options += ["--head", f"--node-ip-address={ADDRESS}", "--include-dashboard=false"]
            options += [f"--port={self.address.partition(':')[2]}", f"--temp-dir={self.folder}"]
        else:
            options += [f"--address={self.address}"]
        for _ in range(STARTS):
            token, began = uuid.uuid4().hex, time.perf_counter()
            done = subprocess.run(
                [Path(sys.executable).with_name("ray"), "start", *options],
                env={**os.environ, TOKEN: token, "PYTHONPATH": os.pathsep.join(sys.path)},
                capture_output=True,
                text=True,
                check=False,
            )
            if done.returncode == 0:
                self.nodes.append(token)
                return time.perf_counter() - began
            end(token)  # a busy machine starts Ray too slowly for its own limits
        raise SystemExit(f"Ray did not start: {done.stderr[-500:]}")

    def kill(self) -> int:
        """Kill the node that was started last; return how many processes it had."""
        return end(self.nodes.pop())

    def stop(self) -> None:
        """Stop all nodes."""
        while self.nodes:
            self.kill()


def end(token: str) -> int:
    """Kill all processes with a token, and their descendants; return how many there were."""
    ended: set[int] = set()
    while living := descendants(set(family(token)) - {os.getpid()}) - ended:
        for pid in living:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        ended |= living
    return len(ended)


def descendants(pids: set[int]) -> set[int]:
    """Return processes with all that they started; Ray's workers overwrite their environment."""
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            with suppress(OSError):
                text = (entry / "stat").read_text()
                parents[int(entry.name)] = int(text.rpartition(")")[2].split()[1])
    found = set(pids)
    while more := {pid for pid, parent in parents.items() if parent in found} - found:
        found |= more
    return found


def free_port() -> int:
    """Return a free port."""
    with socket.socket() as probe:
        probe.bind((ADDRESS, 0))
        return int(probe.getsockname()[1])


def outcomes(out: Path) -> pl.DataFrame:
    """Return a campaign's outcomes but for the time that each took."""
    return Store(out).outcomes().drop("computed_s")


def sizes(count: int) -> dict[str, float]:
    """Return bytes that are sent: to a node for each setup, and for each trial to and fro."""
    requests, setups = campaign(count)
    batch = batches.Batches(requests, np.arange(count))[0]
    found = run_batch(setups[batch.setup], batch)
    return {
        "setup": len(pickle.dumps(setups[batch.setup])),
        "there": len(pickle.dumps(batch)) / len(batch.rows),
        "back": len(pickle.dumps(found)) / len(found),
    }


def rates(cluster: Cluster, folder: Path, options: argparse.Namespace) -> dict[str, Any]:
    """Run the campaign in each way in turn; return the figures of all rounds."""
    found: dict[str, Any] = {"one": [], "local": [], "ray": []}
    for number in range(options.rounds):
        for kind, figures in found.items():
            count = options.trials // 2 if kind == "one" else options.trials
            driver = Driver(folder / f"{kind}{number}", kind, count, cluster.address)
            figures.append(driver.figures())
            show(f"round {number + 1}, {kind}: {figures[-1]['rate']:.1f} trials/s")
    driver = Driver(folder / "instant", "instant", INSTANT_TRIALS, cluster.address)
    found["instant"] = [driver.figures()]
    show(f"trials that take no time: {found['instant'][0]['rate']:,.0f}/s")
    return found


def disturbed(
    cluster: Cluster, folder: Path, count: int, disturb: Callable[[Driver], None]
) -> pl.DataFrame:
    """Run a campaign on the cluster, and disturb it when a third is done; return its outcomes."""
    driver = Driver(folder, "ray", count, cluster.address)
    stored = driver.wait_for(1 / 3)
    disturb(driver)
    if driver.process.wait(LONGEST_S) == -signal.SIGKILL:
        before = kept(folder)
        again = Driver(folder, "ray", count, cluster.address).figures()
        show(f"  {before} trials were kept; {count - int(again['before'])} were run after it")
    else:
        show(f"  at {stored} of {count} trials; the campaign went on to its end")
    return outcomes(folder)


def report(found: dict[str, Any], sent: dict[str, float], started: list[float]) -> list[str]:
    """Return the lines for the page."""

    def median(kind: str, name: str) -> float:
        return statistics.median(figures[name] for figures in found[kind])

    one, local, ray = (median(kind, "rate") for kind in ("one", "local", "ray"))
    ratios = [r["rate"] / p["rate"] for r, p in zip(found["ray"], found["local"], strict=True)]
    cpu, large = median("ray", "driver_cpu_ms"), median("instant", "driver_cpu_ms")
    load = " ".join(Path("/proc/loadavg").read_text().split()[:3])
    rows = [
        ("trials/s, one process", f"{one:.1f}"),
        ("trials/s, two local workers", f"{local:.1f}"),
        ("trials/s, two nodes of one core", f"{ray:.1f}"),
        (
            "cluster / local workers, median (rounds)",
            f"{statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})",
        ),
        ("cluster / twice one process", f"{ray / (2 * one):.2f}"),
        ("until the first batch, local workers", f"{median('local', 'start_s'):.1f} s"),
        ("until the first batch, cluster", f"{median('ray', 'start_s'):.1f} s"),
        ("start of the head and of the second node", " and ".join(f"{s:.0f} s" for s in started)),
        ("the driver's CPU time, batches of 16", f"{cpu:.2f} ms a trial"),
        ("the same, batches of 256", f"{large:.3f} ms a trial"),
        (
            "trials/s that a driver submits and stores, batches of 256",
            f"{median('instant', 'rate'):,.0f}",
        ),
        ("sent to a node once, a setup", f"{sent['setup'] / 1e3:.0f} kB"),
        ("sent to a node and back, a trial", f"{sent['there']:.0f} B and {sent['back']:.0f} B"),
    ]
    head = f"{os.cpu_count()} cores, load {load}, {len(ratios)} rounds"
    return [f"| {head} | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows)]


def measure(options: argparse.Namespace, folder: Path, cluster: Cluster) -> int:
    """Run everything; return the exit code."""
    started = [cluster.start(), cluster.start()]
    show(f"two nodes at {cluster.address}, started in {started[0]:.0f} s and {started[1]:.0f} s")
    found = rates(cluster, folder, options)
    whole = outcomes(folder / "local0")

    def kill_node(_: Driver) -> None:
        show(f"  killed {cluster.kill()} processes")

    show("a node is killed:")
    results = {"rounds": outcomes(folder / "ray0")}
    results["a killed node"] = disturbed(cluster, folder / "node", options.trials, kill_node)
    show("the driver is killed:")
    results["a killed driver"] = disturbed(
        cluster, folder / "driver", options.trials, lambda driver: driver.process.kill()
    )
    same = {name: table.equals(whole) for name, table in results.items()}
    show("", *report(found, sizes(64), started))
    for name, equal in same.items():
        said = "the same bit for bit" if equal else "OTHER OUTCOMES"
        show(f"| outcomes after {name}, of {len(whole)} trials | {said} |")
    return 0 if all(same.values()) else 1


def show(*lines: str) -> None:
    print(*lines, sep="\n", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=800)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument(
        "--drive", choices=("one", "local", "ray", "instant"), help=argparse.SUPPRESS
    )
    parser.add_argument("--out", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--address", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.drive:
        drive(options.out, options.drive, options.trials, options.address)
        return 0
    folder = Path(tempfile.mkdtemp(prefix="gc", dir="/tmp"))
    cluster = Cluster(folder / "ray")
    try:
        return measure(options, folder / "campaigns", cluster)
    finally:
        cluster.stop()
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    sys.exit(main())
