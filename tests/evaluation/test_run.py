"""An interrupted run is resumed; saved forecasts of another configuration are not reused."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from numpy.testing import assert_array_equal

import synthetic
from graspcast.bop.models import Models
from graspcast.evaluation.benchmark import Benchmark
from graspcast.evaluation.protocols import Task
from graspcast.evaluation.run import forecast_all
from poses import write_models


@dataclass(frozen=True)
class Counting:
    """Success rate of training, counting how often it was asked."""

    setting: int = 0
    asked: list[str] = field(default_factory=list, repr=False)
    breaks_at: int = field(default=10**6, repr=False)

    def __call__(self, task: Task) -> np.ndarray:
        if len(self.asked) == self.breaks_at:
            raise KeyboardInterrupt
        self.asked.append(task.protocol)
        return np.full(len(task.test), task.train.own_success.mean())


@pytest.fixture(scope="module")
def benchmark(tmp_path_factory: pytest.TempPathFactory) -> Benchmark:
    folder = write_models(tmp_path_factory.mktemp("models"), obj_1={}, obj_2={})
    return synthetic.benchmark({"d": Models(folder)})


PROTOCOLS = ("random_split", "unseen_object")
ALL = 3 * 2 * (1 + 2)  # pairs times tasks


def test_all_pairs_and_progress(benchmark: Benchmark) -> None:
    method, moves = Counting(), []
    found = forecast_all(
        benchmark, {"m": method}, PROTOCOLS, progress=lambda share, words: moves.append(share)
    )
    cells = [(f.protocol, f.principal, f.gripper) for f in found]
    assert cells == [(p, *pair) for p in PROTOCOLS for pair in benchmark.pairs()]
    assert len(method.asked) == ALL
    assert moves == sorted(moves)
    assert moves[-1] == 1.0


def test_saved_forecasts_are_reused(benchmark: Benchmark, tmp_path: Path) -> None:
    stopped = Counting(breaks_at=8)
    with pytest.raises(KeyboardInterrupt):
        forecast_all(benchmark, {"m": stopped}, PROTOCOLS, work=tmp_path)
    done = len(list(tmp_path.rglob("*.npz")))
    assert done == 7  # six of the split, one of an unseen object; the next was cut short
    again = Counting()
    whole = forecast_all(benchmark, {"m": again}, PROTOCOLS, work=tmp_path)
    assert len(again.asked) == ALL - 6 - 2
    for kept, fresh in zip(
        whole, forecast_all(benchmark, {"m": Counting()}, PROTOCOLS), strict=True
    ):
        assert_array_equal(kept.probability, fresh.probability)


@pytest.mark.parametrize("what", ["setting", "seed", "outcomes", "truth", "nothing"])
def test_another_setting_seed_or_datum_is_computed_anew(
    benchmark: Benchmark, tmp_path: Path, what: str
) -> None:
    forecast_all(benchmark, {"m": Counting()}, ["random_split"], work=tmp_path)
    method = Counting(setting=int(what == "setting"))
    changed = benchmark
    if what == "outcomes":
        flipped = benchmark.outcomes.with_columns(success=1 - pl.col("success"))
        changed = replace(benchmark, outcomes=flipped, _joined={})
    if what == "truth":
        changed = replace(benchmark, truth=benchmark.truth[::-1].copy())
    forecast_all(changed, {"m": method}, ["random_split"], work=tmp_path, seed=int(what == "seed"))
    assert len(method.asked) == (0 if what == "nothing" else 6)
