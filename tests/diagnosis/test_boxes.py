"""Boxes against projected models."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy import ndarray

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
