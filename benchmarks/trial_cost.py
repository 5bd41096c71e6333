"""Cost and labels of trials, compared with those of another version of this package.

    python benchmarks/trial_cost.py --data DATA --before CHECKOUT [--trials 300] [--seed 0]
        [--shift-nm 0] [--json FILE]

A random sample of the published trials, all 29 pairs of object and gripper in turn, is run by both
versions under both protocols. Each version has a process of its own, and the two take turns trial
by trial, so that a busy machine disturbs both alike; times are CPU times. It prints, by protocol
and gripper, the ratios of CPU time and of steps (now / before), and how many labels, reasons and
records of the approach differ. ``DATA`` holds ``published/`` and ``bop/``; ``CHECKOUT`` is a
directory with the other version in ``src/``. Each version uses its own reference grasps.

``--shift-nm 1`` moves the estimates of this version by a nanometre. With this checkout as
``CHECKOUT``, or with the other one as both, that shows how many labels are a matter of rounding.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

PROTOCOLS = ("paper", "robot")


def main() -> None:
    parser = argparse.ArgumentParser(description="Cost and labels of trials by two versions.")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--before", type=Path, required=True)
    parser.add_argument("--trials", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--shift-nm", type=float, default=0.0)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        work(options.data, options.shift_nm)
    else:
        compare(options)


def work(data: Path, shift_nm: float) -> None:
    """Run trials that are asked for on standard input, one JSON line each."""
    from graspcast.paper.dataset import Published
    from graspcast.paper.validation import published_trials
    from graspcast.simulation.campaign.jobs import load_setups
    from graspcast.simulation.grasps.table import read_grasps
    from graspcast.simulation.trial.trial import TrialRunner, TrialSettings

    published = Published(data)
    requests = published_trials(published).requests
    bop_dirs = {name: dataset.root for name, dataset in published.bop.items()}
    setups = load_setups(requests, read_grasps(None), bop_dirs=bop_dirs)
    pairs = list(zip(requests.keys["object"], requests.keys["gripper"], strict=True))
    answer({"pairs": pairs})
    runners: dict[tuple[Any, ...], Any] = {}
    for line in sys.stdin:
        row, protocol = json.loads(line)
        pair = pairs[row]
        setup = setups[pair]
        estimate = requests.obj_T_est[row].copy()
        estimate[:3, 3] += shift_nm * 1e-9
        if (pair, protocol) not in runners:
            settings = TrialSettings.paper() if protocol == "paper" else None
            runners[pair, protocol] = TrialRunner(setup.grasp_object, setup.gripper, settings)
            runners[pair, protocol].run(estimate, setup.grasp)
        started = time.process_time()
        outcome = runners[pair, protocol].run(estimate, setup.grasp)
        seconds = time.process_time() - started
        answer({**asdict(outcome), "cpu_s": seconds})


def answer(values: dict[str, Any]) -> None:
    """Write one JSON line to standard output."""
    print(json.dumps(values, default=lambda value: value.item()), flush=True)


class Worker:
    """Process that runs trials with the source of one checkout."""

    def __init__(self, checkout: Path, data: Path, shift_nm: float = 0.0):
        command = [sys.executable, str(Path(__file__).resolve()), "--worker"]
        command += ["--data", str(data), "--before", ".", "--shift-nm", str(shift_nm)]
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": str(checkout.resolve() / "src")},
        )

    def read(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit("a process that ran trials ended early; its message is above")
        return dict(json.loads(line))

    def run(self, row: int, protocol: str) -> dict[str, Any]:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps([row, protocol]) + "\n")
        self.process.stdin.flush()
        return self.read()


def compare(options: argparse.Namespace) -> None:
    """Run the sample with both versions, and print the comparison."""
    here = Path(__file__).resolve().parents[1]
    workers = [
        Worker(options.before, options.data),
        Worker(here, options.data, options.shift_nm),
    ]
    pairs, others = (worker.read()["pairs"] for worker in workers)
    if pairs != others:
        raise SystemExit("the two versions read different trials")
    found = []
    for row in sample(pairs, options.trials, options.seed):
        for protocol in PROTOCOLS:
            before, now = (worker.run(row, protocol) for worker in workers)
            found.append((protocol, pairs[row], row, before, now))
        if options.json and len(found) % 50 == 0:
            options.json.write_text(json.dumps(found))
    if options.json:
        options.json.write_text(json.dumps(found))
    for worker in workers:
        worker.process.communicate()
    report(found)


def sample(pairs: list[Any], count: int, seed: int) -> list[int]:
    """Return rows chosen at random, spread evenly over the published trials of each pair."""
    order = np.random.default_rng(seed).permutation(len(pairs)).tolist()
    # Within each pair the shares of its rows seen so far; sorted by them, any part is stratified.
    seen: dict[tuple[str, ...], int] = {}
    shares = []
    totals: dict[tuple[str, ...], int] = {}
    for pair in pairs:
        totals[tuple(pair)] = totals.get(tuple(pair), 0) + 1
    for row in order:
        pair = tuple(pairs[row])
        shares.append(seen.get(pair, 0) / totals[pair])
        seen[pair] = seen.get(pair, 0) + 1
    return [order[k] for k in np.argsort(shares, kind="stable").tolist()][:count]


def report(found: list[Any]) -> None:
    """Print ratios and differences by protocol and gripper."""
    header = ["protocol", "gripper", "trials", "CPU ratio", "steps ratio", "ms before", "ms now"]
    header += ["labels", "reasons", "short_m > 0.1 mm", "force_n > 1 %", "hit"]
    print("| " + " | ".join(header) + " |\n" + "|---" * len(header) + "|")
    for protocol in PROTOCOLS:
        for gripper in (*sorted({pair[1] for _, pair, *_ in found}), "both"):
            rows = [
                (before, now)
                for of, pair, _, before, now in found
                if of == protocol and gripper in (pair[1], "both")
            ]
            print("| " + " | ".join([protocol, gripper, *figures(rows)]) + " |")


def figures(rows: list[tuple[dict[str, Any], dict[str, Any]]]) -> list[str]:
    """Return the cells of one row of the report."""
    cpu = [sum(outcomes[k]["cpu_s"] for outcomes in rows) for k in (0, 1)]
    steps = [sum(outcomes[k]["steps"] for outcomes in rows) for k in (0, 1)]

    def differ(name: str, absolute: float = 0.0, relative: float = 0.0) -> int:
        count = 0
        for before, now in rows:
            one, other = before[name], now[name]
            if isinstance(one, float) and isinstance(other, float):
                close = np.isclose(one, other, rtol=relative, atol=absolute, equal_nan=True)
                count += not close
            else:
                count += one != other
        return count

    numbers = [differ("success"), differ("reason"), differ("short_m", absolute=1e-4)]
    numbers += [differ("force_n", absolute=0.1, relative=0.01), differ("hit")]
    return [
        str(len(rows)),
        f"{cpu[1] / cpu[0]:.3f}",
        f"{steps[1] / steps[0]:.3f}",
        f"{1e3 * cpu[0] / len(rows):.1f}",
        f"{1e3 * cpu[1] / len(rows):.1f}",
        *map(str, numbers),
    ]


if __name__ == "__main__":
    main()
