"""Which campaign's trials were guided by a verdict's own pose."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from graspcast.bop.results import write_results
from graspcast.forecasting.verdict import VerdictRow
from graspcast.report.pairing import outcomes_of
from graspcast.report.trials import Trials, read_trials
from small_run import outcomes, results, verdicts


def trials(folder: Path, name: str, rows: list[VerdictRow], source: str = "") -> Trials:
    outcomes(rows).write_csv(folder / name)
    manifest: dict[str, Any] = {"sources": {"fused on d": source}} if source else {}
    return Trials(folder / name, read_trials(folder / name).table, manifest)


def test_the_poses_tell_campaigns_of_one_estimator_apart(tmp_path: Path) -> None:
    two, three = verdicts(2), verdicts(3)
    for name, rows in (("fused2_d-test.csv", two), ("fused3_d-test.csv", three)):
        write_results(tmp_path / name, results(rows))
    files = {name: tmp_path / name for name in ("fused2_d-test.csv", "fused3_d-test.csv")}
    run = [
        trials(tmp_path, "t3.csv", three, "runs/fused3_d-test.csv"),
        trials(tmp_path, "t2.csv", two, "fused2_d-test.csv"),
        trials(tmp_path, "t1.csv", verdicts(1)),
    ]
    for rows, number in ((two, 1), (three, 0)):
        found = outcomes_of(rows, run, files, tmp_path / "v.csv")
        assert [n for n, _ in found.outcomes] == [number] and not found.problems
    # Without the results files it is not known, and said.
    found = outcomes_of(two, run, {}, tmp_path / "v.csv")
    assert found.table is None
    assert "hold outcomes of the same trials of fused" in found.problems[0]
    assert "v.csv is not known" in found.problems[0]


def test_tables_of_other_trials_are_put_together(tmp_path: Path) -> None:
    rows = verdicts(1)
    run = [trials(tmp_path, "a.csv", rows[:10]), trials(tmp_path, "b.csv", rows[10:])]
    found = outcomes_of(rows, run, {}, tmp_path / "v.csv")
    assert found.table is not None and len(found.table) == len(rows)
    assert outcomes_of(verdicts(1, dataset="e"), run, {}, tmp_path / "v.csv").table is None
