"""Kill the writer of an attempt log at random moments, and count what is lost, doubled or damaged.

    python benchmarks/log_kills.py --kills 1000

Each writer is a process of its own that appends frames and outcomes from two threads, and tells
each record on a pipe after it was acknowledged. It is killed with SIGKILL at a random moment: one
in five from its start on, so also while it opens the log, the others after their first record. The
next writer opens the same log and goes on.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from graspcast.attempt_log import AttemptLog, DecisionRecord, FrameRecord, OutcomeRecord
from graspcast.errors import FormatError, InputError

_POSE = np.eye(4)


def made_frame(name: str, decisions: int) -> FrameRecord:
    """Return a frame with some decisions, ``name.0``, ``name.1`` and so on."""
    found = [
        DecisionRecord(
            id=f"{name}.{i}",
            instance=i,
            object_name="ycbv-5",
            action="attempt",
            probability=0.9,
            threshold=0.8,
            guarantee=None,
            reason="probability 0.900 reaches 0.8",
            guide="epos",
            cam_T_obj=_POSE,
            world_T_obj=None,
            gripper="franka",
            grasp="reference",
            views=1,
            looks=1,
        )
        for i in range(decisions)
    ]
    estimates = {
        name: [("ycbv-5", _POSE, 0.9)] * decisions for name in ("epos", "gdrnpp", "zebrapose")
    }
    return FrameRecord(episode=name, look=1, estimates=estimates, decisions=found, source="api")


def write(path: Path, writer: int, pipe: int) -> None:
    """Write until killed, and tell on a pipe what was acknowledged."""
    log = AttemptLog.open(path)

    def go_on(thread: int) -> None:
        rng = random.Random(f"{writer} {thread}")
        number = 0
        while True:
            batch = []
            for _ in range(rng.randint(1, 4)):
                batch.append(made_frame(f"{writer}.{thread}.{number}", rng.randint(1, 3)))
                number += 1
            log.add(batch)
            names = [decision.id for frame in batch for decision in frame.decisions]
            os.write(pipe, "".join(f"d {name}\n" for name in names).encode())
            for name in names[:2]:
                log.add_outcome(OutcomeRecord(name, rng.random() < 0.5))
                os.write(pipe, f"o {name}\n".encode())

    threads = [threading.Thread(target=go_on, args=(n,)) for n in range(2)]
    for thread in threads:
        thread.start()


def kill_one(path: Path, writer: int, delay_s: float, *, from_start: bool) -> list[str]:
    """Start a writer, kill it after a delay, and return the records that were acknowledged."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.close(reading)
        try:
            write(path, writer, writing)
            threading.Event().wait()
        finally:
            os._exit(1)
    os.close(writing)
    told: list[bytes] = []
    began = threading.Event()
    drain = threading.Thread(target=_drain, args=(reading, told, began))
    drain.start()
    if not from_start:
        began.wait(30.0)
    time.sleep(delay_s)
    os.kill(child, signal.SIGKILL)
    status = os.waitpid(child, 0)[1]
    drain.join()
    if os.waitstatus_to_exitcode(status) != -signal.SIGKILL:
        raise RuntimeError(f"writer {writer} ended by itself: {status}")
    # What was cut off in the middle was acknowledged too, but its name is not known.
    text = b"".join(told)
    return text.decode().splitlines()[: text.count(b"\n")]


def _drain(pipe: int, told: list[bytes], began: threading.Event) -> None:
    """Read a pipe to its end, and say when the first came."""
    while part := os.read(pipe, 65536):
        told.append(part)
        began.set()
    os.close(pipe)
    began.set()


def run(path: Path, kills: int, longest_s: float, seed: int = 0) -> dict[str, Any]:
    """Kill writers one after another, and return the counts."""
    rng = random.Random(seed)
    acknowledged: list[str] = []
    before_first = 0
    for writer in range(kills):
        from_start = rng.random() < 0.2
        told = kill_one(path, writer, rng.uniform(0.0, longest_s), from_start=from_start)
        before_first += not told
        acknowledged += told
        if writer % 100 == 99:
            print(f"{writer + 1} kills, {len(acknowledged)} acknowledged", file=sys.stderr)
    return {"kills": kills, "killed_before_a_record": before_first, **faults(path, acknowledged)}


def faults(path: Path, acknowledged: list[str]) -> dict[str, Any]:
    """Return how many records there are, and how many are lost, doubled, cut or out of order."""
    try:
        AttemptLog.open(path).close()  # recovers what the last writer left
        log = AttemptLog.read(path)
        counts, damaged = log.check(), 0
    except (FormatError, InputError) as error:
        return {"damaged": 1, "why": str(error)}
    decisions = log.decisions()
    names = decisions["id"].to_list()
    outcomes = log.outcomes()["decision_id"].to_list()
    there = {*(f"d {name}" for name in names), *(f"o {name}" for name in outcomes)}
    doubled = sum(n - 1 for n in Counter(names).values())
    doubled += sum(n - 1 for n in Counter(outcomes).values())
    order = [tuple(map(int, name.split("."))) for name in names]
    by_thread: dict[tuple[int, ...], list[tuple[int, ...]]] = {}
    for key in order:
        by_thread.setdefault(key[:2], []).append(key)
    disordered = sum(keys != sorted(keys) for keys in by_thread.values())
    disordered += [key[0] for key in order] != sorted(key[0] for key in order)
    # The decisions of a frame are there all or not at all: their numbers begin at 0, without gaps.
    cut = sum(
        sorted(i) != list(range(len(i)))
        for (i,) in decisions.group_by("frame").agg("instance").select("instance").rows()
    )
    return {
        "damaged": damaged,
        "decisions": counts["decision"],
        "outcomes": counts["outcome"],
        "acknowledged": len(acknowledged),
        "lost": len(set(acknowledged) - there),
        "doubled": doubled,
        "cut": cut,
        "disordered": disordered,
    }


def main() -> None:
    """Print the counts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=1000)
    parser.add_argument("--longest-ms", type=float, default=120.0, help="life of a writer at most")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.db"
        found = run(path, options.kills, options.longest_ms / 1000.0, options.seed)
        size = path.stat().st_size if path.exists() else 0
    print(", ".join(f"{name} {value}" for name, value in found.items()), f"({size:,} bytes)")
    if any(found.get(name) for name in ("damaged", "lost", "doubled", "cut", "disordered")):
        sys.exit(1)


if __name__ == "__main__":
    main()
