"""The table of forecasts with several views, its scores, and resuming."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest
from polars.testing import assert_frame_equal

from graspcast.evaluation.benchmark import Benchmark
from graspcast.evaluation.view_fusion import fuse_benchmark
from graspcast.evaluation.view_sets import ViewRow
from graspcast.evaluation.view_table import ONE_VIEW, forecast_with_views
from viewed import SMALL, benchmark

pytestmark = pytest.mark.slow  # the table is forecast once, for all of them

ROWS = [ViewRow("2 views", 2), ViewRow("3 views", 3)]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Benchmark:
    found, sources = benchmark(tmp_path_factory.mktemp("models"))
    return replace(found, views=fuse_benchmark(sources, found.estimates, ROWS))


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("work")


@pytest.fixture(scope="module")
def table(whole: Benchmark, work: Path) -> pl.DataFrame:
    return forecast_with_views(whole, "several_views", ROWS, settings=SMALL, work=work)


def test_every_guide_and_row_is_there(whole: Benchmark, table: pl.DataFrame) -> None:
    counts = dict(
        table.group_by("row", "principal")
        .len()
        .select(pl.concat_str("row", "principal", separator=" "), "len")
        .rows()
    )
    assert counts["3 views a"] == counts["2 views fused"] == len(whole)
    assert counts[f"{ONE_VIEW.name} fused"] == len(whole)


def test_outcomes_are_those_of_the_guide(whole: Benchmark, table: pl.DataFrame) -> None:
    part = table.filter(pl.col("principal") == "b", pl.col("row") == "3 views").sort("instance")
    trials = whole.outcomes.filter(pl.col("estimator") == "b")
    assert part["success"].cast(pl.Int64).to_list() == trials["success"].to_list()
    assert table.filter(pl.col("principal") == "fused")["success"].is_null().all()


def test_before_the_last_look_a_forecast_after_the_next_is_expected(table: pl.DataFrame) -> None:
    belief = table.filter(pl.col("row") == ONE_VIEW.name)
    assert belief["expected"].is_between(0, 1).all()
    assert belief["expected"].mean() > belief["probability"].mean()


def test_saved_folds_are_read_again(
    whole: Benchmark, table: pl.DataFrame, work: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("trained again")

    monkeypatch.setattr("graspcast.evaluation.view_table.train_fold", never)
    again = forecast_with_views(whole, "several_views", ROWS, settings=SMALL, work=work)
    assert_frame_equal(again, table)
    with pytest.raises(AssertionError, match="trained again"):
        forecast_with_views(whole, "several_views", ROWS, settings=SMALL, work=work, seed=1)
