"""A dataset's files are read; refusals become findings."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from sick_files import case_of, healthy


def test_whole_files_are_read(tmp_path: Path) -> None:
    case = case_of(healthy().write(tmp_path))
    assert case.name == "toy"
    assert case.findings == []
    assert list(case.results) == ["a", "b"]
    assert case.models is not None
    assert len(case.truths) == 1


def test_a_refused_part_leaves_the_others(tmp_path: Path) -> None:
    files = healthy()
    for entry in files.info.values():
        entry |= {key: value / 1000 for key, value in entry.items()}
    case = case_of(files.write(tmp_path))
    assert [f.code for f in case.findings] == ["models-unit"]
    assert case.models is None
    assert list(case.results) == ["a", "b"]


def test_rows_that_can_be_read_are_kept(tmp_path: Path) -> None:
    files = healthy()
    files.estimates["a"][1][3, 2, 3] *= -1
    case = case_of(files.write(tmp_path))
    assert len(case.results["a"]) == 47
    assert case.doubts["a"].code == "poses-behind"


BOXES: list[dict[str, Any]] = [
    {"scene_id": 1, "image_id": i, "category_id": 1, "score": 0.9, "bbox": [9.0, 9.0, 50.0, 50.0]}
    for i in range(12)
]


@pytest.mark.parametrize(
    ("change", "rows", "doubts", "findings"),
    [
        ({}, [12], [], []),
        ({"score": "high"}, [11], ["boxes-unreadable"], []),
    ],
)
def test_detections_are_read_row_by_row_where_some_are_bad(
    tmp_path: Path, change: dict[str, Any], rows: list[int], doubts: list[str], findings: list[str]
) -> None:
    paths, path = healthy(names=()).write(tmp_path), tmp_path / "boxes.json"
    path.write_text(json.dumps([BOXES[0] | change, *BOXES[1:]]))
    case = case_of([*paths, (None, path)])
    assert [len(d) for d in case.detections] == rows
    assert [d.code for d in case.doubts.values()] == doubts
    assert [f.code for f in case.findings] == findings


@pytest.mark.parametrize(
    ("content", "code"),
    [
        ([b | {"bbox": [0.1, 0.1, 0.2, 0.2]} for b in BOXES], "boxes-shares"),
        ({"bbox": 1, "obj_id": 2}, "boxes-unreadable"),
    ],
)
def test_detections_that_cannot_be_read_are_one_finding(
    tmp_path: Path, content: Any, code: str
) -> None:
    paths, path = healthy(names=()).write(tmp_path), tmp_path / "boxes.json"
    path.write_text(json.dumps(content))
    case = case_of([*paths, (None, path)])
    assert [(f.code, f.path) for f in case.findings] == [(code, str(path))]
    assert case.detections == []


def test_results_without_any_row_that_can_be_read(tmp_path: Path) -> None:
    paths = healthy(names=()).write(tmp_path)
    cut, few = tmp_path / "cut_toy-test.csv", tmp_path / "few_toy-test.csv"
    cut.write_text("scene_id,im_id,obj_id,score,R\n1,1,1,0.5,1\n")
    few.write_text("scene_id,im_id,obj_id,score,R,t,time\n1,1,1,0.5,1 0 0 0 1 0 0 0 1,x,-1\n")
    case = case_of([*paths, ("cut", cut), ("few", few)])
    assert [(f.path, f.severity) for f in case.findings] == [
        (str(cut), "error"),
        (str(few), "error"),
    ]
    assert case.results == {} and case.doubts == {}


def test_outcomes_that_cannot_be_read_are_a_finding(tmp_path: Path) -> None:
    paths, path = healthy(names=()).write(tmp_path), tmp_path / "trials.csv"
    path.write_text("estimator,dataset,scene_id,im_id,obj_id,gripper,success\na,toy,1,1,1,p,yes\n")
    case = case_of([*paths, (None, path)])
    (finding,) = case.findings
    assert finding.path == str(path) and case.outcomes == {}


def test_camera_poses_of_a_file(tmp_path: Path) -> None:
    paths, path = healthy(names=()).write(tmp_path), tmp_path / "poses.csv"
    path.write_text("scene_id,im_id,world_T_cam_m\n1,0,1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n")
    case = case_of([*paths, (None, path)])
    assert [m.source for m in case.motions] == [str(path)] and case.findings == []
    path.write_text(path.read_text() + "1,1,nonsense\n")
    case = case_of([*paths, (None, path)])
    assert case.motions == [] and [f.path for f in case.findings] == [str(path)]


def test_a_camera_that_cannot_be_read_is_unknown(tmp_path: Path) -> None:
    paths = healthy(names=()).write(tmp_path)
    folder = tmp_path / "toy" / "test" / "000001"
    (folder / "scene_camera.json").write_text('{"0": {"cam_K": "none"}}')
    case = case_of(paths)
    assert [f.severity for f in case.findings] == ["error"]
    assert case.scenes[0].camera(1, 0) is None
    (folder / "scene_camera.json").unlink()
    assert case_of(paths).scenes[0].camera(1, 0) is not None
