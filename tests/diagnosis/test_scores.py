"""Scores and poses that carry nothing."""

from __future__ import annotations

from pathlib import Path

from graspcast.diagnosis.scores import repeated_poses, score_findings
from sick_files import case_of, healthy


def test_nothing_of_whole_files(tmp_path: Path) -> None:
    case = case_of(healthy().write(tmp_path))
    assert [*score_findings(case), *repeated_poses(case)] == []


def test_one_score_for_everything(tmp_path: Path) -> None:
    files = healthy()
    files.scores["b"] = 0.0
    (finding,) = score_findings(case_of(files.write(tmp_path)))
    assert (finding.code, finding.severity) == ("scores-constant", "note")
    assert "all 48 scores are 0" in finding.message


def test_poses_that_come_again(tmp_path: Path) -> None:
    files = healthy()
    files.estimates["a"][1][:5] = files.estimates["a"][1][5:10]
    (finding,) = repeated_poses(case_of(files.write(tmp_path)))
    assert finding.numbers["repeated"] == 5
