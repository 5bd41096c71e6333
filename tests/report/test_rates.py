"""Success rates of groups."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.evaluation.bootstrap import Interval
from graspcast.report.rates import interval_cell, rate_of, rates_by, rates_section
from graspcast.report.run_data import RunData


def test_rates_are_those_of_the_rows(run: RunData) -> None:
    decisions = run.decisions
    assert decisions is not None
    found = {rate.name[0]: rate for rate in rates_by(decisions, ["object"])}
    assert set(found) == {"d-1", "d-2"}
    mine = decisions.at(1).filter(object="d-1")
    assert found["d-1"].first.always.value == pytest.approx(mine["success"].mean())
    assert found["d-1"].first.n == len(mine) and found["d-1"].first.scenes == 5
    ended = decisions.last.filter(object="d-1", attempt=True)
    following = found["d-1"].last.following
    assert following is not None and following.value == pytest.approx(ended["success"].mean())
    section = rates_section(decisions)
    assert [table.key for table in section.tables] == [
        "rates-by-object",
        "rates-by-gripper-and-grasp",
    ]
    assert [row[0].text for row in section.tables[0].rows] == ["d-1", "d-2"]
    (figure,) = section.figures
    assert [row[0] for row in figure.rows] == ["d-1", "d-2"] and "success_always" in figure.columns


def test_cells_and_what_has_no_outcome(run: RunData) -> None:
    assert run.decisions is not None
    assert rate_of(run.decisions.table.clear()) is None
    cell = interval_cell(Interval(0.5, 0.25, 0.75))
    assert cell.text == "0.500 [0.250, 0.750]" and cell.ends == (0.25, 0.75)
    assert interval_cell(None).value is None
    assert interval_cell(Interval(0.5, np.nan, np.nan)).text == "0.500"
