"""What a campaign of N trials costs the process that plans it and stores its outcomes.

    python benchmarks/campaign_driver.py [--trials 10000 100000 1000000] [--appends 60]

No trial is run: outcomes are made up. Each number of trials has a process of its own, which

- plans: checks the requests, hashes them for the manifest, divides them into batches;
- stores: some batches of the size that such a campaign has, as they come from the workers, and
  their share of a merge of 500;
- resumes: reads all outcomes, and finds the trials that are left (of a half that is stored);
- finishes: writes ``outcomes.parquet`` and the dataset card;
- reads: as a program that uses the outcomes does.

It prints time, peak memory, size and number of files, and what the last two numbers of trials mean
for ten million, on a straight line. The lines can be pasted into ``docs/cluster.md``.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import polars as pl

from graspcast.estimates.outcomes import ERROR_COLUMNS
from graspcast.pose.transforms import exp
from graspcast.simulation.campaign import campaign, store
from graspcast.simulation.campaign.batches import Batches, batch_size
from graspcast.simulation.campaign.dataset_card import write_card
from graspcast.simulation.campaign.jobs import load_setups
from graspcast.simulation.campaign.requests import TrialRequests
from graspcast.simulation.campaign.store import Store
from graspcast.simulation.grasps.table import read_grasps
from graspcast.simulation.trial.trial import Outcome

TARGET = 10_000_000
ROWS = {
    "plan_s": ("plan (s)", "{:.1f}"),
    "store_ms": ("store, merges included (ms a batch)", "{:.1f}"),
    "batch": ("trials in a batch", "{:.0f}"),
    "files": ("files while it runs, at most", "{:.0f}"),
    "resume_s": ("resume with half of it stored (s)", "{:.1f}"),
    "finish_s": ("finish (s)", "{:.1f}"),
    "read_s": ("read all outcomes (s)", "{:.1f}"),
    "disk_mb": ("outcomes.parquet (MB)", "{:.1f}"),
    "peak_gb": ("peak memory (GB)", "{:.2f}"),
}


def planned(count: int) -> TrialRequests:
    """Return trials of the tomato soup can by the parallel gripper, off by a centimetre and 6°."""
    random = np.random.default_rng(0)
    keys = pl.DataFrame({"im_id": np.arange(count)}).with_columns(
        estimator=pl.lit("drawn"),
        dataset=pl.lit("ycbv"),
        scene_id=pl.lit(0),
        obj_id=pl.lit(4),
        est_id=pl.lit(0),
        gripper=pl.lit("parallel"),
    )
    return TrialRequests(keys, exp(random.normal(size=(count, 6)) * ([0.01] * 3 + [0.1] * 3)))


def results(count: int) -> list[Outcome]:
    """Return made-up outcomes as they come from a worker."""
    return [Outcome(True, "held", 0.001 * k, 2.5, 0.02, 900 + k) for k in range(count)]


def made_up(requests: TrialRequests, rows: np.ndarray) -> pl.DataFrame:
    """Return made-up outcomes of some trials, with the columns of true ones."""
    count = len(rows)
    random = np.random.default_rng(int(rows[0]))
    floats = (*ERROR_COLUMNS, "offset_m", "short_m", "force_n", "simulated_s", "computed_s")
    held = random.random(count) < 0.5
    columns = {name: random.normal(size=count) for name in floats}
    return requests.keys[rows].with_columns(
        **columns,
        success=held,
        reason=pl.Series(np.where(held, "held", "missed")),
        hit=pl.lit("object"),
        steps=random.integers(100, 2000, count),
        settings=pl.lit("0123456789abcdef"),
        mujoco=pl.lit("4.0.0"),
    )


def work(count: int, appends: int, folder: Path) -> None:
    """Measure one number of trials, and print the figures as JSON."""
    figures = {"trials": float(count), "batch": float(batch_size(count))}
    requests = planned(count)
    setups = load_setups(requests, read_grasps())
    began = time.perf_counter()
    requests = TrialRequests(requests.keys, requests.obj_T_est)
    manifest = campaign._manifest(requests, setups, {})
    nothing = pl.DataFrame(schema=store.COLUMNS)
    batches = Batches(requests, campaign._rows_left(requests, nothing))
    figures["plan_s"] = time.perf_counter() - began

    # One merge for every 500 batches, measured on as many as are written.
    size = batch_size(count)
    few = [(batch, results(len(batch.rows))) for batch in batches[:appends]]
    scratch = Store(folder / "scratch")
    scratch.begin(manifest)
    began = time.perf_counter()
    for batch, outcomes in few:
        scratch.append(campaign._table(requests, batch, outcomes, setups[batch.setup]))
    each = (time.perf_counter() - began) / len(few)
    began = time.perf_counter()
    scratch._add(scratch.outcomes(), 1)
    figures["store_ms"] = 1e3 * (each + (time.perf_counter() - began) / len(few))
    most = store._MOST_SHARDS
    figures["files"] = min(len(batches), most) + len(batches) // most

    # As it lies on the disk when it is complete, but for the last small shards.
    whole = Store(folder / "whole")
    whole.begin(manifest)
    step = size * most
    starts = range(0, count, step)
    for start in starts[: max(1, len(starts) // 2)]:
        whole._add(made_up(requests, np.arange(start, min(start + step, count))), 1)
    began = time.perf_counter()
    resumed = Store(folder / "whole")
    resumed.begin(manifest)
    len(Batches(requests, campaign._rows_left(requests, resumed.outcomes())))
    figures["resume_s"] = time.perf_counter() - began
    for start in starts[max(1, len(starts) // 2) :]:
        whole._add(made_up(requests, np.arange(start, min(start + step, count))), 1)
    began = time.perf_counter()
    stored = whole.finish()
    write_card(whole.directory, stored, manifest)
    figures["finish_s"] = time.perf_counter() - began
    del stored
    began = time.perf_counter()
    assert len(Store(folder / "whole").outcomes()) == count
    figures["read_s"] = time.perf_counter() - began
    figures["disk_mb"] = (whole.directory / store.OUTCOMES).stat().st_size / 1e6
    figures["peak_gb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(json.dumps(figures))


def measured(count: int, appends: int) -> dict[str, float]:
    """Measure one number of trials in a process of its own."""
    folder = Path(tempfile.mkdtemp(prefix="campaign"))
    command = [sys.executable, str(Path(__file__).resolve()), "--work", str(folder)]
    command += ["--trials", str(count), "--appends", str(appends)]
    try:
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return dict(json.loads(done.stdout))


def extrapolated(last: list[dict[str, float]]) -> dict[str, float]:
    """Return the figures of the target on the line through the last two."""
    one, two = last
    share = (TARGET - two["trials"]) / (two["trials"] - one["trials"])
    found = {name: two[name] + share * (two[name] - one[name]) for name in ROWS}
    # A cost of each batch; the number of files is known.
    found["store_ms"], found["batch"] = two["store_ms"], batch_size(TARGET)
    batches = -(-TARGET // batch_size(TARGET))
    found["files"] = store._MOST_SHARDS + batches // store._MOST_SHARDS
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--appends", type=int, default=60)
    parser.add_argument("--work", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.work:
        work(options.trials[0], options.appends, options.work)
        return
    found = [measured(count, options.appends) for count in options.trials]
    columns = [f"{figures['trials']:,.0f}" for figures in found]
    if len(found) > 1 and options.trials[-1] < TARGET:
        columns.append(f"{TARGET:,}, extrapolated")
        found.append(extrapolated(found[-2:]))
    load = " ".join(Path("/proc/loadavg").read_text().split()[:3])
    print(f"{os.cpu_count()} cores, load {load}")
    print(f"| trials | {' | '.join(columns)} |")
    print("|---" * (len(columns) + 1) + "|")
    for name, (words, form) in ROWS.items():
        print(f"| {words} | {' | '.join(form.format(figures[name]) for figures in found)} |")


if __name__ == "__main__":
    main()
