"""Reports, written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest

from graspcast.errors import InputError
from graspcast.forecasting.verdict import Verdict
from graspcast.forecasting.verdict_file import write_verdicts
from graspcast.io.progress import Count
from graspcast.report.run_files import RunFiles, find_run
from graspcast.report.write import write_report
from small_run import outcomes, verdicts


@pytest.mark.slow
def test_the_same_files_give_the_same_bytes(tmp_path: Path, run_dir: Path) -> None:
    files = find_run(run_dir)
    said: list[tuple[float, str]] = []
    notes = write_report(
        tmp_path / "a.html", [files], written="now", progress=lambda *told: said.append(told)
    )
    assert notes == () and said[:2] == [(0.0, "reading small"), (0.0, "scoring")]
    # What is counted alone has a rate and a time left.
    drawn = [(share, text) for share, text in said[2:] if isinstance(text, Count)]
    assert drawn == said[2:] and all(share == count.share for share, count in drawn)
    write_report(tmp_path / "b.html", [files], written="now")
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
    write_report(tmp_path / "c.html", [files], written="then", title="Mine")
    text = (tmp_path / "c.html").read_text()
    assert "written then" in text and "<title>Mine</title>" in text
    assert str(run_dir) not in text.replace(f"graspcast report {run_dir}", "")


def test_without_outcomes_or_without_verdicts(tmp_path: Path, run_dir: Path) -> None:
    files = find_run(run_dir)
    write_report(tmp_path / "r.html", [replace(files, outcomes=())])
    text = (tmp_path / "r.html").read_text()
    assert "There are no outcomes to score them by" in text and 'id="verdicts"' in text
    assert "graspcast simulate" in text and 'id="risk-coverage"' not in text
    write_report(tmp_path / "r.html", [replace(files, verdicts=(), outcomes=files.outcomes)])
    text = (tmp_path / "r.html").read_text()
    assert "There are no verdicts on them" in text and 'id="error-translation"' in text


@pytest.mark.parametrize(
    ("column", "value"),
    [("success", 1), ("success", 0), ("error_x_m", float("inf")), ("error_x_m", 1e12)],
)
def test_outcomes_at_the_edge(tmp_path: Path, column: str, value: float) -> None:
    rows = verdicts(1, looks=1)
    write_verdicts(tmp_path / "v.csv", rows)
    outcomes(rows).with_columns(pl.lit(value).alias(column)).write_csv(tmp_path / "o.csv")
    files = RunFiles("edge", verdicts=(tmp_path / "v.csv",), outcomes=(tmp_path / "o.csv",))
    assert write_report(tmp_path / "r.html", [files], cases=1) == ()


@pytest.mark.parametrize("which", ["one", "scene", "no forecast"])
def test_few_verdicts(tmp_path: Path, which: str) -> None:
    rows = verdicts(1, looks=1)
    none = Verdict(False, None, "no supporter")
    rows = {
        "one": rows[:1],
        "scene": [row for row in rows if row.key.scene_id == 1],
        "no forecast": [replace(row, verdict=none) for row in rows],
    }[which]
    write_verdicts(tmp_path / "v.csv", rows)
    outcomes(verdicts(1, looks=1)).write_csv(tmp_path / "o.csv")
    files = RunFiles("few", verdicts=(tmp_path / "v.csv",), outcomes=(tmp_path / "o.csv",))
    assert write_report(tmp_path / "r.html", [files], cases=1) == ()


def test_nothing_is_written_where_it_fails(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no run"):
        write_report(tmp_path / "r.html", [])
    with pytest.raises(InputError, match="there is nothing to report"):
        write_report(tmp_path / "r.html", [RunFiles("empty")])
    assert list(tmp_path.iterdir()) == []
