"""Cases to look at."""

from __future__ import annotations

from graspcast.report.cases import GALLERY, choose_cases
from graspcast.report.run_data import RunData


def test_each_kind_has_its_worst_and_no_grasp_comes_twice(run: RunData) -> None:
    decisions = run.decisions
    assert decisions is not None
    chosen = {mode.key: mode for mode in choose_cases(decisions, 2)}
    last = decisions.last
    for key, mode in chosen.items():
        assert len(mode.rows) <= (7 if key == GALLERY else 2) and (mode.of or key == GALLERY)
        if key.startswith("attempted-"):
            assert mode.rows["attempt"].all() and mode.rows["success"].to_list() == [0] * len(
                mode.rows
            )
            assert set(mode.rows["outcome"]) == {key.removeprefix("attempted-")}
    timid = chosen["abstained-held"].rows
    assert timid["probability"].is_sorted()
    lowest = last.filter(attempt=False, success=1, unusual=False)["probability"].min()
    assert timid["probability"][0] == lowest
    assert chosen["unusual"].rows["unusual"].all()
    instances = [i for mode in chosen.values() for i in mode.rows["instance"]]
    assert len(instances) == len(set(instances))


def test_looking_again_that_helped_and_the_gallery_of_each_outcome(run: RunData) -> None:
    assert run.decisions is not None
    chosen = choose_cases(run.decisions, 1)
    assert chosen[0].key == GALLERY
    assert chosen[0].rows["outcome"].n_unique() == len(chosen[0].rows)
    again = next(mode for mode in chosen if mode.key == "looked-again").rows
    first = run.decisions.at(1).filter(instance=again["instance"][0])
    assert first["success"][0] == 0 and not first["attempt"][0]
    assert again["success"][0] == 1 and again["attempt"][0] and again["look"][0] == 2


def test_without_reasons_or_errors_there_are_fewer_kinds(run: RunData) -> None:
    from dataclasses import replace

    import polars as pl

    assert run.decisions is not None
    table = run.decisions.table.with_columns(
        outcome=pl.lit(None, pl.String), error_m=pl.lit(None, pl.Float64)
    )
    keys = {mode.key for mode in choose_cases(replace(run.decisions, table=table), 3)}
    assert "attempted-failed" in keys and not keys & {"near", "far", GALLERY}
