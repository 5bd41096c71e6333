"""Risk-coverage and reliability."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.evaluation.scores import risk_coverage, score
from graspcast.guarantees.certificate import Certificate
from graspcast.guarantees.certify import certify
from graspcast.report.forecast_quality import after, forecast_section
from graspcast.report.run_data import RunData


def a_certificate() -> Certificate:
    rng = np.random.default_rng(0)
    probability = rng.uniform(size=400)
    return certify(
        probability,
        rng.uniform(size=400) < 0.5 + probability / 2,
        np.array([f"d/{k}" for k in range(400)]),
        rate=0.6,
        confidence=0.9,
    )


def test_the_curve_ends_at_the_failure_rate_of_all(run: RunData) -> None:
    assert run.decisions is not None
    section = forecast_section(run.decisions, [])
    risk, *reliability = section.figures
    for look in (1, 2):
        mine = run.decisions.at(look)
        curve = [row for row in risk.rows if row[:2] == ("curve", after(look, 2))]
        expected = risk_coverage(mine["probability"].to_numpy(), mine["success"].to_numpy() == 1)
        assert curve[-1][2] == 1.0
        assert curve[-1][3] == pytest.approx(float(expected.risk[-1]))
        (place,) = [row for row in risk.rows if row[:2] == ("threshold", after(look, 2))]
        tried = mine.filter("attempt")
        assert place[2] == pytest.approx(len(tried) / len(mine))
        assert place[3] == pytest.approx(1 - tried["success"].mean())  # type: ignore[operator]
        table = reliability[look - 1]
        assert sum(row[2] for row in table.rows) == len(mine)  # type: ignore[misc]
        found = score(
            mine["probability"].to_numpy(),
            mine["success"].to_numpy() == 1,
            np.array(mine["object"].to_list()),
        )
        assert section.tables[0].rows[look - 1][3].value == pytest.approx(found.brier)


def test_a_certificate_is_marked(run: RunData) -> None:
    assert run.decisions is not None
    certificate = a_certificate()
    assert certificate.overall.threshold is not None
    risk = forecast_section(run.decisions, [certificate]).figures[0]
    kinds = {row[0] for row in risk.rows}
    assert {"certificate", "guaranteed"} <= kinds
    assert f"threshold {certificate.overall.threshold:.3g}" in risk.svg
    assert "failure rate of at most 0.4" in risk.svg


def test_no_outcomes_no_section(run: RunData) -> None:
    from dataclasses import replace

    assert run.decisions is not None
    none = replace(run.decisions, table=run.decisions.table.clear())
    assert forecast_section(none, []).is_empty
