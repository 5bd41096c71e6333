"""Grasps guided by a single view that another view contradicts, and no third decides.

Reads the forecasts that ``graspcast evaluate --protocols several_views --work WORK`` saves, on
scenes that are not in training, and compares the success of grasps forecast from one view at 0.8 or
more: where the views contradict each other so that one is left, and where they agree.

    python benchmarks/contradictions.py --data DATA --work WORK
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import polars as pl

from graspcast.evaluation.benchmark import Benchmark
from graspcast.io.markdown import table
from graspcast.paper.dataset import Published

LEAST = 0.8


def interval(held: np.ndarray, scenes: np.ndarray, draws: int) -> str:
    names, number = np.unique(scenes, return_inverse=True)
    good, all_of = (np.bincount(number, w, minlength=len(names)) for w in (held, None))
    picked = np.random.default_rng(0).integers(0, len(names), (draws, len(names)))
    rate = good[picked].sum(axis=1) / all_of[picked].sum(axis=1)
    low, high = np.quantile(rate, (0.025, 0.975))
    return f"{held.mean():.3f} [{low:.3f}, {high:.3f}]"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--draws", type=int, default=1000)
    given = parser.parse_args()
    benchmark = Benchmark.of(Published(given.data))
    names = pl.DataFrame(
        {
            "instance": np.arange(len(benchmark)),
            "dataset": benchmark.estimates.instances.dataset.astype(str),
            "scene": benchmark.scenes.astype(str),
        }
    )
    found = pl.read_parquet(given.work / "several_views" / "*.parquet")
    found = found.filter(pl.col("success").is_not_null()).join(names, on="instance")
    rows = []
    for name in ("2 views", "3 views", "one estimator alone, 2 views"):
        for (dataset, gripper), part in (
            found.filter(row=name)
            .sort("dataset", "gripper")
            .group_by("dataset", "gripper", maintain_order=True)
        ):
            cells = [name, str(dataset), str(gripper)]
            alone = (pl.col("entered") == 1) & (pl.col("views") > 1)
            for which in (alone, ~alone):
                mine = part.filter(which)
                sure = mine.filter(pl.col("one_view") >= LEAST)
                held = sure["success"].to_numpy().astype(float)
                rate = interval(held, sure["scene"].to_numpy(), given.draws) if len(sure) else "-"
                cells += [str(len(mine)), str(len(sure)), str(sure["scene"].n_unique()), rate]
            rows.append(cells)
    each = ["n", f"p >= {LEAST}", "scenes", "success"]
    header = [
        "forecast",
        "dataset",
        "gripper",
        *(f"{w}: {c}" for w in ("contradict", "agree") for c in each),
    ]
    print(table(header, rows))


if __name__ == "__main__":
    main()
