"""Scores and poses that carry nothing."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

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


def test_one_time_for_everything_and_few_rows(tmp_path: Path) -> None:
    case = case_of(healthy().write(tmp_path))
    case.results["b"] = replace(case.results["b"], time_s=np.full(48, 0.25))
    case.results["a"] = case.results["a"].select(np.arange(4))
    (finding,) = score_findings(case)
    assert (finding.code, finding.severity, finding.estimator) == ("times-constant", "note", "b")
    assert "all 48 times are 0.25 s" in finding.message


def test_one_score_for_all_boxes(tmp_path: Path) -> None:
    paths = healthy(names=()).write(tmp_path)
    boxes = [
        {"scene_id": 1, "image_id": i, "category_id": 1, "score": 1.0, "bbox": [9, 9, 50, 50]}
        for i in range(8)
    ]
    (tmp_path / "boxes.json").write_text(json.dumps(boxes))
    (finding,) = score_findings(case_of([*paths, (None, tmp_path / "boxes.json")]))
    assert (finding.code, finding.severity) == ("scores-constant", "note")
    assert finding.path.endswith("boxes.json") and "all 8 scores are 1" in finding.message
