"""Meshes and the symmetries that are stated."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from graspcast.bop.meshes import Mesh, read_mesh, write_mesh
from graspcast.bop.models_writing import info_entry
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


def other_meshes(tmp_path: Path, change: Callable[[Mesh], Mesh]) -> list[str]:
    """What is found of a second directory of models with changed meshes."""
    paths = healthy().write(tmp_path)
    models = tmp_path / "toy" / "models"
    shutil.copytree(models, tmp_path / "toy" / "models_eval")
    for path in (tmp_path / "toy" / "models_eval").glob("*.ply"):
        write_mesh(path, change(read_mesh(path)))
    case = case_of(paths)
    assert case.findings == []
    return [f.code for f in shape_findings(case)]


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda m: m, []),
        (lambda m: Mesh(m.vertices * [-1, 1, 1], m.faces[:, ::-1]), ["mesh-mirrored"]),
        (lambda m: Mesh(m.vertices + [0.0, 0.008, 0.0], m.faces), ["models-differ"]),
    ],
)
def test_two_directories_of_models(
    tmp_path: Path, change: Callable[[Mesh], Mesh], expected: list[str]
) -> None:
    assert other_meshes(tmp_path, change) == expected


def test_a_symmetric_shape_is_noted_until_that_is_stated(tmp_path: Path) -> None:
    files = healthy()
    box = trimesh.creation.box((0.09, 0.05, 0.03)).subdivide().subdivide()
    files.meshes[1] = Mesh(np.array(box.vertices), np.array(box.faces))
    files.info["1"] = info_entry(files.meshes[1].vertices)
    case = case_of(files.write(tmp_path / "1"))
    (finding,) = shape_findings(case)
    assert (finding.severity, finding.code) == ("note", "shape-symmetric")
    turns = [np.diag(d) for d in ([1.0, -1, -1, 1], [-1.0, 1, -1, 1], [-1.0, -1, 1, 1])]
    files.info["1"]["symmetries_discrete"] = [turn.ravel().tolist() for turn in turns]
    assert codes(files, tmp_path / "2") == []


def test_models_without_a_mesh_or_without_faces_are_passed_over(tmp_path: Path) -> None:
    files = healthy()
    files.meshes[2] = Mesh(files.meshes[2].vertices, np.empty((0, 3), dtype=np.int64))
    paths = files.write(tmp_path)
    (tmp_path / "toy" / "models" / "obj_000001.ply").unlink()
    assert list(shape_findings(case_of(paths))) == []
