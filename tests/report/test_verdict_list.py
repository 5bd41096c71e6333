"""The list of verdicts."""

from __future__ import annotations

import base64

import pytest

import graspcast.report.verdict_list as verdict_list
from graspcast.report.run_data import RunData
from graspcast.report.verdict_list import verdicts_section


def test_the_table_has_the_last_verdicts_and_the_csv_all(
    run: RunData, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run.decisions is not None
    (table,) = verdicts_section(run.decisions).tables
    assert len(table.rows) == len(run.decisions.last) and table.caption.startswith("All verdicts")
    lines = base64.b64decode(table.uri.partition(",")[2]).decode().splitlines()
    assert len(lines) == 1 + len(run.decisions.table) and lines[0].startswith("object,scene_id")
    monkeypatch.setattr(verdict_list, "MOST_SHOWN", 5)
    monkeypatch.setattr(verdict_list, "MOST_IN_CSV", 7)
    (table,) = verdicts_section(run.decisions).tables
    assert len(table.rows) == 5 and "The first 5 of 30 verdicts" in table.caption
    assert "holds the first 7 verdicts after every look" in table.caption
