"""Object models: sizes and symmetries."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from graspcast.bop.models import Models, read_models_info
from graspcast.errors import FormatError, UnknownNameError
from poses import random_poses, write_models


def test_models_and_symmetries(tmp_path: Path) -> None:
    half_turn = [-1, 0, 0, 10, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    axis = {"axis": [0, 0, 2], "offset": [5, 0, 0]}
    models = Models(
        write_models(
            tmp_path,
            obj_1={},
            obj_2={"symmetries_discrete": [half_turn]},
            obj_3={"symmetries_continuous": [axis], "symmetries_discrete": [half_turn]},
        )
    )
    assert not models[1].symmetric
    assert_array_equal(models[1].symmetries, np.eye(4)[None])
    assert models[2].symmetries.shape == (2, 4, 4)
    assert models[2].symmetries[1, 0, 3] == 0.01
    assert_allclose(models[1].size, [0.04, 0.06, 0.1])
    everything = models[3].symmetries
    assert len(everything) == 2 * 315
    assert_array_equal(everything[0], np.eye(4))
    # Every turn about the axis keeps the points of the axis where they are.
    turns = everything[: len(everything) // 2]
    assert_allclose(turns @ [0.005, 0, 0.3, 1], np.tile([0.005, 0, 0.3, 1], (315, 1)), atol=1e-12)
    with pytest.raises(UnknownNameError, match="unknown object '9'; known: 1, 2, 3"):
        models[9]


@pytest.mark.parametrize(
    ("info", "says"),
    [
        ({"1": {}}, "object 1: no 'diameter'"),
        ({}, "lists no object"),
        ({"one": {}}, "'one' is not a whole number"),
        ({"1": {"diameter": -1}}, "diameter should be positive"),
        ({"1": {"diameter": "x"}}, "object 1, diameter: should be 1 finite number"),
    ],
)
def test_wrong_models_info_is_named(tmp_path: Path, info: Any, says: str) -> None:
    path = tmp_path / "models_info.json"
    path.write_text(json.dumps(info))
    with pytest.raises(FormatError) as caught:
        read_models_info(path)
    assert says in str(caught.value)


def test_symmetries_must_be_rotations(tmp_path: Path) -> None:
    write_models(tmp_path, obj_1={"symmetries_discrete": [[2.0] * 16]})
    with pytest.raises(
        FormatError, match="symmetries_discrete: holds a matrix that is not a rotation"
    ):
        Models(tmp_path)
    write_models(
        tmp_path, obj_1={"symmetries_continuous": [{"axis": [0, 0, 0], "offset": [0, 0, 0]}]}
    )
    with pytest.raises(FormatError, match="the axis has no length"):
        Models(tmp_path)


@pytest.mark.slow
def test_published_meshes_have_the_published_extents(data_dir: Path) -> None:
    for name in ("lmo", "ycbv"):
        models = Models(data_dir / "bop" / name / "models")
        for obj_id, info in models.info.items():
            vertices = models.mesh(obj_id).vertices
            assert_allclose(vertices.min(axis=0), info.lower, atol=3e-4)
            assert_allclose(np.ptp(vertices, axis=0), info.size, atol=3e-4)


def test_contradicting_lengths_are_named(tmp_path: Path) -> None:
    write_models(tmp_path, obj_1={"diameter": 12.3})
    with pytest.raises(FormatError, match=r"object 1: the diameter is 12\.3 mm, but"):
        Models(tmp_path)
    small = {f"{key}_{axis}": value for axis in "xyz" for key, value in (("min", 0), ("size", 10))}
    models = Models(write_models(tmp_path, obj_1=small | {"diameter": 12.3}))
    for read in (models.check_a_mesh, lambda: models.mesh(1)):
        with pytest.raises(
            FormatError, match=r"12\.3 mm, but the mesh's longest side is 100 mm; .* centimetres"
        ):
            read()
    axis = {"axis": [0, 0, 1], "offset": [500, 0, 0]}
    write_models(tmp_path, obj_1={"symmetries_continuous": [axis]})
    with pytest.raises(FormatError, match=r"offset: moves the object's centre by 1\.00 m"):
        Models(tmp_path)


def test_a_mesh_is_compared_where_there_is_one(tmp_path: Path) -> None:
    models = Models(write_models(tmp_path, obj_1={}, obj_2={}))
    assert models.lengths == "123 mm across (by models_info.json)"
    models.check_a_mesh()
    assert models.lengths == "123 mm across (models_info.json; 1 mesh agrees)"
    models.mesh(1)
    models.mesh(2)
    assert models.lengths == "123 mm across (models_info.json; 2 meshes agree)"
    (tmp_path / "obj_000001.ply").write_text("no mesh")
    Models(tmp_path).check_a_mesh()  # whoever needs it says so


def test_distances_of_estimates_are_compared_with_diameters(tmp_path: Path) -> None:
    models = Models(write_models(tmp_path, obj_1={}))
    poses, ones = random_poses(6, 1), np.ones(6, dtype=int)
    models.check_distances("a.csv", ones, poses)
    wrong = poses.copy()
    wrong[:, :3, 3] /= 10
    with pytest.raises(FormatError, match=r"a\.csv: the median distance of t is .* in centimetres"):
        models.check_distances("a.csv", ones, wrong)
    models.check_distances("a.csv", ones + 4, wrong)  # no model of it
    models.check_distances("a.csv", ones[:0], poses[:0])


def test_bounds_and_offsets_that_are_missing(tmp_path: Path) -> None:
    axis: Any = {"symmetries_continuous": [{"axis": [0, 0, 1]}]}
    folder = write_models(tmp_path / "models", obj_1=axis)
    path = folder / "models_info.json"
    whole = read_models_info(path)[1]
    assert whole.continuous[0].offset.tolist() == [0, 0, 0]
    entry = json.loads(path.read_text())["1"]
    path.write_text(json.dumps({"1": {"diameter": entry["diameter"]}}))
    info = read_models_info(path)[1]
    assert_allclose([*info.lower, *info.size], [*whole.lower, *whole.size])
    path.write_text(json.dumps({"1": {"diameter": entry["diameter"], "min_x": -20}}))
    with pytest.raises(FormatError, match="object 1: no 'min_y'"):
        read_models_info(path)
    path.write_text(json.dumps({"7": {"diameter": entry["diameter"]}}))
    with pytest.raises(FormatError, match=r"object 7: no min_x, …, size_z, and no obj_000007.ply"):
        read_models_info(path)


def test_vertices_of_no_face_are_left_out_where_the_bounds_say_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = write_models(tmp_path / "models")
    path = folder / "obj_000001.ply"
    box: Any = trimesh.creation.box((40, 60, 100))
    vertices = np.concatenate([box.vertices, [[900.0, 0, 0]]])
    made = trimesh.Trimesh(vertices, box.faces, process=False)
    path.write_bytes(made.export(file_type="ply"))
    mesh = Models(folder).mesh(1)
    assert_allclose(np.ptp(mesh.vertices, axis=0), [0.04, 0.06, 0.1], atol=1e-7)
    assert len(mesh.faces) == 12 and len(mesh.vertices) == 8
    assert [r.getMessage() for r in caplog.records] == [
        f"{path}: vertices of no face are left out: 1"
    ]
    box.apply_scale(1000)
    path.write_bytes(box.export(file_type="ply"))
    with pytest.raises(FormatError, match="the mesh's longest side is 100 m"):
        Models(folder).mesh(1)


def test_symmetries_that_are_no_lists_or_move_the_object_are_named(tmp_path: Path) -> None:
    for key in ("symmetries_discrete", "symmetries_continuous"):
        write_models(tmp_path, obj_1={key: {}})
        with pytest.raises(FormatError, match=rf"object 1, {key}: should be a list"):
            Models(tmp_path)
    away = [-1, 0, 0, 900, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    write_models(tmp_path, obj_1={"symmetries_discrete": [away]})
    with pytest.raises(FormatError, match=r"symmetries_discrete: moves the object's centre by"):
        Models(tmp_path)


def test_objects_that_no_hand_grasps_are_named(tmp_path: Path) -> None:
    large = {f"{key}_{a}": v for a in "xyz" for key, v in (("min", -50000), ("size", 100000))}
    write_models(tmp_path, obj_1=large | {"diameter": 173205.0})
    with pytest.raises(FormatError, match=r"the median diameter is 173 m, but a hand grasps"):
        read_models_info(tmp_path / "models_info.json")


def test_one_mesh_is_compared_once(tmp_path: Path) -> None:
    models = Models(write_models(tmp_path, obj_1={}))
    models.check_a_mesh()
    (tmp_path / "obj_000001.ply").write_text("no mesh any more")
    models.check_a_mesh()
    assert models.lengths.endswith("1 mesh agrees)")
