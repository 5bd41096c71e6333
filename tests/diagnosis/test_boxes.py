"""Boxes against projected models."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy import ndarray
from PIL import Image

from graspcast.bop.meshes import Mesh
from graspcast.diagnosis.boxes import box_findings
from sick_files import K, SickFiles, case_of, healthy


def found(files: SickFiles, tmp_path: Path) -> list[str]:
    case = case_of(files.write(tmp_path))
    assert case.findings == []
    return [f.code for f in box_findings(case)]


def test_nothing_of_whole_files(tmp_path: Path) -> None:
    assert found(healthy(), tmp_path) == []


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda b: np.hstack([b[:, :2], b[:, :2] + b[:, 2:]]), "boxes-corners"),
        (lambda b: np.hstack([b[:, :2] + b[:, 2:] / 2, b[:, 2:]]), "boxes-centre"),
        (lambda b: b[:, [1, 0, 3, 2]], "boxes-swapped"),
        (lambda b: b / 2, "boxes-other-size"),
    ],
)
def test_other_forms_of_boxes(
    tmp_path: Path, change: Callable[[ndarray], ndarray], code: str
) -> None:
    files = healthy()
    files.boxes = {i: change(b) for i, b in files.boxes.items()}
    assert found(files, tmp_path) == [code]


@pytest.mark.parametrize(
    ("camera", "code"),
    [
        (K * [[0.5] * 3, [0.5] * 3, [1, 1, 1]], "camera-other-size"),
        (K * [[1.6, 1, 1], [1, 1.6, 1], [1, 1, 1]], "camera-wrong"),
        (K + np.array([[0, 0, 60], [0, 0, -50], [0, 0, 0]]), "camera-wrong"),
    ],
)
def test_other_cameras(tmp_path: Path, camera: ndarray, code: str) -> None:
    files = healthy()
    files.K = camera
    case = case_of(files.write(tmp_path))
    (finding,) = box_findings(case)
    assert finding.code == code
    np.testing.assert_allclose(finding.numbers["fitted"], [600, 600, 320, 240], atol=0.5)


def test_a_mirrored_mesh(tmp_path: Path) -> None:
    files = healthy()
    mesh = files.meshes[1]
    files.meshes[1] = Mesh(mesh.vertices * [1, -1, 1], mesh.faces[:, ::-1])
    assert "mesh-mirrored" in found(files, tmp_path)


def detected(files: SickFiles, change: Callable[[ndarray], ndarray]) -> list[dict[str, Any]]:
    """Detections with the true boxes, changed."""
    return [
        {"scene_id": 1, "image_id": im, "category_id": i, "score": 0.9, "bbox": box.tolist()}
        for i, boxes in files.boxes.items()
        for im, box in enumerate(change(boxes))
    ]


@pytest.mark.parametrize("with_truth", [True, False])
@pytest.mark.parametrize(
    ("change", "expected"), [(lambda b: b, []), (lambda b: b[:, [1, 0, 3, 2]], ["boxes-swapped"])]
)
def test_detections_against_the_models_at_true_or_estimated_poses(
    tmp_path: Path,
    with_truth: bool,
    change: Callable[[ndarray], ndarray],
    expected: list[str],
) -> None:
    files = healthy()
    boxes = detected(files, change)
    paths = files.write(tmp_path, with_truth=with_truth)
    if not with_truth:
        folder = tmp_path / "toy" / "test" / "000001" / "rgb"
        folder.mkdir()
        Image.new("RGB", (640, 480)).save(folder / "000000.png")
    path = tmp_path / "boxes_toy.json"
    path.write_text(json.dumps(boxes))
    case = case_of([*paths, (None, path)])
    assert case.findings == []
    found = list(box_findings(case))
    assert [f.code for f in found] == expected
    assert all(f.path == str(path) for f in found)


def test_few_boxes_and_a_wrong_camera_prove_nothing_of_detections(tmp_path: Path) -> None:
    files = healthy()
    boxes = detected(files, lambda b: b[:, [1, 0, 3, 2]])
    files.K = K * [[1.6, 1, 1], [1, 1.6, 1], [1, 1, 1]]
    paths, path = files.write(tmp_path), tmp_path / "boxes_toy.json"
    path.write_text(json.dumps(boxes))
    assert [f.code for f in box_findings(case_of([*paths, (None, path)]))] == ["camera-wrong"]
    path.write_text(json.dumps(boxes[:5]))
    files.K = K.copy()
    paths = files.write(tmp_path / "2")
    assert list(box_findings(case_of([*paths, (None, path)]))) == []


@pytest.mark.parametrize(
    ("factor", "severity", "code"),
    [(10.0, "error", "models-unit"), (3.0, "warning", "boxes-contradict")],
)
def test_boxes_that_are_larger_than_the_models(
    tmp_path: Path, factor: float, severity: str, code: str
) -> None:
    files = healthy()
    for boxes in files.boxes.values():  # each about its own place, as no camera would do
        middle, rng = boxes[:, :2] + boxes[:, 2:] / 2, np.random.default_rng(1)
        boxes[:, 2:] *= factor
        boxes[:, :2] = middle - boxes[:, 2:] / 2 + rng.normal(0, 400, middle.shape)
    found = list(box_findings(case_of(files.write(tmp_path))))
    assert [(f.severity, f.code) for f in found] == [(severity, code)]
