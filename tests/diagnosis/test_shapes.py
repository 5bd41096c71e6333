"""Meshes and the symmetries that are stated."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from graspcast.bop.meshes import Mesh
from graspcast.diagnosis.shapes import shape_findings
from graspcast.pose.transforms import rotation_from_vector, transform
from sick_files import SickFiles, case_of, healthy


def codes(files: SickFiles, tmp_path: Path) -> list[str]:
    return [f.code for f in shape_findings(case_of(files.write(tmp_path)))]


def test_nothing_of_whole_files(tmp_path: Path) -> None:
    assert codes(healthy(), tmp_path) == []


def test_a_symmetry_that_the_mesh_lacks(tmp_path: Path) -> None:
    files = healthy()
    turn = transform(rotation_from_vector(np.array([0, 0, np.pi])), np.zeros(3))
    files.info["1"]["symmetries_discrete"] = [turn.ravel().tolist()]
    assert codes(files, tmp_path) == ["symmetry-contradicted"]


def test_a_mesh_whose_x_was_negated(tmp_path: Path) -> None:
    files = healthy()
    files.meshes[2] = Mesh(files.meshes[2].vertices * [1, -1, 1], files.meshes[2].faces)
    assert "mesh-mirrored" in codes(files, tmp_path)
