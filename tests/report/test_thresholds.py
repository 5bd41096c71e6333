"""What other thresholds would be worth."""

from __future__ import annotations

from dataclasses import replace

import pytest

from graspcast.evaluation.net_benefit import Costs
from graspcast.report.run_data import RunData
from graspcast.report.thresholds import thresholds_section
from small_run import THRESHOLD


def test_the_threshold_in_use_and_the_best_one_are_in_the_table(run: RunData) -> None:
    decisions = run.decisions
    assert decisions is not None
    section = thresholds_section(decisions, Costs(failure=5.0))
    (table,) = section.tables
    which = {row[-1].text: row for row in table.rows}
    (used,) = [row for text, row in which.items() if "in use" in text]
    assert used[0].value == THRESHOLD
    last = decisions.at(2).filter(unusual=False)
    tried = last.filter(last["probability"] >= THRESHOLD)
    assert used[2].value == len(tried)
    assert used[3].value == pytest.approx(tried["success"].mean())
    assert any("best of these" in text for text in which)
    assert "failure 5" in table.caption and section.paragraphs[0].startswith("Best on these grasps")


def test_without_outcomes_there_is_none(run: RunData) -> None:
    assert run.decisions is not None
    none = replace(run.decisions, outcomes=((None, None),))
    assert thresholds_section(none, Costs()).is_empty
