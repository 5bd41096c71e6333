"""Methods: every method forecasts under every protocol."""

from __future__ import annotations

import dataclasses

import polars as pl
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import synthetic
from graspcast.bop.models import Models
from graspcast.evaluation.benchmark import Benchmark
from graspcast.evaluation.methods import (
    METHODS,
    Blended,
    Direct,
    ExtraTrees,
    Majority,
    PaperNetworks,
    Threshold,
    TwoStage,
)
from graspcast.evaluation.protocols import PROTOCOLS, Method, forecast, tasks
from graspcast.evaluation.scores import score
from poses import write_models

QUICK: dict[str, Method] = {
    "majority": Majority(),
    "threshold": Threshold(),
    "MLP": PaperNetworks(pools_objects=False, members=1, epochs=4),
    "MLP-O": PaperNetworks(pools_objects=True, members=1, epochs=4),
    "extra-trees": ExtraTrees(trees=10),
    "direct": Direct(trees=4, draws=4, folds=2),
    "two-stage": TwoStage(trees=4, draws=4, folds=2),
    "blend": Blended(trees=4, draws=4, folds=2),
}


@pytest.fixture(scope="module")
def benchmark(tmp_path_factory: pytest.TempPathFactory) -> Benchmark:
    folder = write_models(tmp_path_factory.mktemp("models"), obj_1={}, obj_2={})
    return synthetic.benchmark({"d": Models(folder)})


def test_the_quick_methods_are_those_that_are_offered() -> None:
    assert QUICK.keys() == METHODS.keys()
    for name, make in METHODS.items():
        assert type(make(3)) is type(QUICK[name])
        assert "seed=3" in repr(make(3))


@pytest.mark.slow
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_flipping_test_outcomes_changes_no_prediction(benchmark: Benchmark, protocol: str) -> None:
    """One fold at a time, since the test outcomes of one fold are training data of another."""
    own = protocol == "unseen_object_simulated"
    first, test = next(iter(tasks(benchmark, protocol, "a", "p")))
    table = benchmark.simulated if own else benchmark.outcomes
    assert table is not None
    mine = (
        (pl.col("estimator") == "a")
        & (pl.col("gripper") == "p")
        & pl.col("im_id").is_in(test.estimates.im_id.tolist())
    )
    flipped = table.with_columns(
        success=pl.when(mine).then(1 - pl.col("success")).otherwise(pl.col("success"))
    )
    changed = {"simulated" if own else "outcomes": flipped}
    other = dataclasses.replace(benchmark, **changed, _joined={})
    second, flipped_test = next(iter(tasks(other, protocol, "a", "p")))
    assert_array_equal(flipped_test.own_success, 1 - test.own_success)
    for method in QUICK.values():
        assert_array_equal(method(second), method(first))


@pytest.mark.slow
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_every_method_answers_every_protocol(benchmark: Benchmark, protocol: str) -> None:
    shares: list[float] = []
    for name, method in QUICK.items():
        found = forecast(
            method, name, benchmark, protocol, "a", "p", progress=lambda x, _: shares.append(x)
        )
        assert (found.protocol, found.method, found.principal) == (protocol, name, "a")
        assert set(found.scenes) <= set(benchmark.scenes)
        if protocol == "unseen_gripper":  # of few folds
            again = forecast(method, name, benchmark, protocol, "a", "p")
            assert_array_equal(found.probability, again.probability)
    assert shares[-1] == 1.0


def test_trees_learn_what_a_rate_cannot_say(benchmark: Benchmark) -> None:
    scores = {}
    for name in ("majority", "extra-trees"):
        f = forecast(QUICK[name], name, benchmark, "unseen_scenes", "a", "p")
        scores[name] = score(f.probability, f.success, f.objects)
    assert scores["majority"].auroc < 0.65
    assert scores["extra-trees"].auroc > 0.75  # a fifth of the outcomes are noise


def test_an_object_without_networks_gets_the_rate_of_all_others(benchmark: Benchmark) -> None:
    for task, _ in tasks(benchmark, "unseen_object", "a", "p"):
        success = task.train.own_success
        expected = (success.sum() + 1) / (len(success) + 2)
        assert_allclose(QUICK["MLP"](task), expected)
        assert_allclose(QUICK["majority"](task), expected)
