"""What following the verdicts is worth."""

from __future__ import annotations

from dataclasses import replace

import polars as pl
import pytest

from graspcast.evaluation.look_scores import Stage, score_looks
from graspcast.report.policies import policies_section, summarise_run
from graspcast.report.run_data import RunData
from small_run import outcomes, verdicts


def test_the_table_is_that_of_the_verb_score(run: RunData) -> None:
    assert run.decisions is not None
    stages = [Stage(verdicts(k), outcomes(verdicts(k))) for k in (1, 2)]
    expected = score_looks(stages)
    (table,) = policies_section(run.decisions).tables
    assert [row[0].text for row in table.rows] == [policy.name for policy in expected.policies]
    for row, policy in zip(table.rows, expected.policies, strict=True):
        assert row[1].value == (None if policy.success is None else policy.success.value)
        assert row[3].value == policy.attempts and row[4].value == pytest.approx(policy.looks)


def test_one_look_has_two_policies(nasty: RunData) -> None:
    assert nasty.decisions is not None
    (table,) = policies_section(nasty.decisions).tables
    assert [row[0].text for row in table.rows] == ["attempting always", "following the verdicts"]


def test_the_lead_says_the_main_result(run: RunData) -> None:
    decisions = run.decisions
    assert decisions is not None
    last = decisions.last.filter("attempt")
    summary = summarise_run(decisions)
    assert f"30 verdicts when looking ends: {len(last)} to attempt" in summary.lead
    assert f"{last['success'].mean():.3f}" in summary.lead
    assert {what for what, *_ in summary.numbers} >= {"verdicts", "attempts succeed"}
    without = replace(decisions, table=decisions.table.with_columns(success=pl.lit(None, pl.Int64)))
    assert "no outcomes" in summarise_run(without).lead
    nothing = replace(decisions, table=decisions.table.with_columns(attempt=pl.lit(False)))
    assert "If all were attempted after one look" in summarise_run(nothing).lead
