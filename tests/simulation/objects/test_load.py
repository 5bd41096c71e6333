from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

from graspcast.errors import ExtraMissingError, InputError, UnknownNameError
from graspcast.pose.transforms import quaternion, rotation_angle, rotation_from_quaternion
from graspcast.simulation.objects.catalogue import read_catalogue
from graspcast.simulation.objects.decomposition import Decomposition
from graspcast.simulation.objects.load import load_mesh, load_object, with_physics
from graspcast.simulation.objects.types import ConvexPiece, GraspObject
from mug import MUG

NAMES = list(read_catalogue())


@pytest.fixture(scope="session")
def bop_dirs(data_dir: Path) -> dict[str, Path]:
    return {name: data_dir / "bop" / name for name in ("lmo", "ycbv")}


def _settle(grasp_object: GraspObject, seconds: float) -> tuple[float, float]:
    """Leave an object alone on a plane; how far and by what angle it has moved."""
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.002
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=(1, 1, 0.1))
    body = spec.worldbody.add_body(name="object")
    body.pos = grasp_object.sim_T_ref[:3, 3]
    body.quat = quaternion(grasp_object.sim_T_ref[:3, :3])
    body.add_freejoint()
    body.explicitinertial, body.mass = True, grasp_object.mass_kg
    body.ipos = grasp_object.centroid
    i = grasp_object.inertia
    body.fullinertia = (*np.diag(i), i[0, 1], i[0, 2], i[1, 2])
    for k, piece in enumerate(grasp_object.pieces):
        assert isinstance(piece, ConvexPiece)
        mesh = spec.add_mesh(name=f"piece{k}", uservert=piece.vertices.ravel().tolist())
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh.name)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=round(seconds / model.opt.timestep))
    R = rotation_from_quaternion(data.qpos[3:7])
    moved = float(np.linalg.norm(data.qpos[:3] - grasp_object.sim_T_ref[:3, 3]))
    return moved, float(rotation_angle(R.T @ grasp_object.sim_T_ref[:3, :3]))


@pytest.mark.slow  # decomposes each mesh once, then takes it from the cache
@pytest.mark.parametrize("name", NAMES)
def test_every_object_rests_in_its_reference_pose(name: str, bop_dirs: dict[str, Path]) -> None:
    entry = read_catalogue()[name]
    loaded = load_object(name, bop_dirs=bop_dirs)
    assert isinstance(entry.collision, Decomposition)
    assert 1 <= len(loaded.pieces) <= entry.collision.pieces
    moved, turned = _settle(loaded, 2.0)
    assert moved < 0.002 and turned < np.deg2rad(1.0)
    # As a person would put it: upright, but for what the unevenness of its base makes it lean.
    assert loaded.sim_T_ref[2, 2] > np.cos(np.deg2rad(5))
    # No part of the mesh is more than a few millimetres below the table.
    lowest = (loaded.vertices @ loaded.sim_T_ref[2, :3]).min() + loaded.sim_T_ref[2, 3]
    assert -0.002 < lowest < 0.004


@pytest.mark.slow
def test_a_ycb_object_is_the_same_from_either_source(bop_dirs: dict[str, Path]) -> None:
    for name in (n for n in NAMES if n.startswith("ycbv")):
        entry = read_catalogue()[name]
        bop, package = load_mesh(entry, bop_dirs), load_mesh(entry)
        for corner in (np.min, np.max):
            np.testing.assert_allclose(
                corner(bop.vertices, axis=0), corner(package.vertices, axis=0), atol=3e-4
            )


def test_by_name_label_or_number() -> None:
    loaded = [load_object(n) for n in ("ycbv-4", "tomato soup can", ("ycbv", 4))]
    assert {o.name for o in loaded} == {"ycbv-4"}
    assert loaded[0].mass_kg == 0.349
    # The centroid is inside, near the middle; its inertia that of a cylinder with sunken ends.
    assert np.linalg.norm(loaded[0].centroid) < 0.005
    solid = 0.349 / 12 * (3 * 0.033**2 + 0.095**2)
    assert loaded[0].inertia[0, 0] == pytest.approx(solid, rel=0.1)


def test_an_object_of_ones_own(mug: Path) -> None:
    loaded = load_object("my mug", catalogue=read_catalogue(mug))
    assert loaded.name == "mug"
    np.testing.assert_allclose(np.ptp(loaded.vertices, axis=0), (0.07, 0.07, 0.09), atol=1e-6)
    np.testing.assert_allclose(loaded.sim_T_ref[2, 3], 0.045, atol=1e-6)
    moved, turned = _settle(loaded, 0.5)
    assert moved < 1e-3 and turned < 1e-2


def test_an_unknown_object_lists_the_known(mug: Path) -> None:
    with pytest.raises(UnknownNameError, match=r"'ycbv-44' \(did you mean 'ycbv-4'.*lmo-1.* ape"):
        load_object("ycbv-44")
    assert "mug" in read_catalogue(mug)


def test_a_licence_that_forbids_and_a_package_that_is_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with pytest.raises(InputError, match="give the BOP directory of lmo"):
        load_object("lmo-1")
    monkeypatch.setattr("graspcast.simulation.objects.load.find_spec", lambda name: None)
    with pytest.raises(ExtraMissingError, match=r"graspcast\[ycb\]"):
        load_object("ycbv-4")


def test_a_direction_in_which_it_topples_lists_those_in_which_it_rests(mug: Path) -> None:
    mug.write_text(MUG.replace("[0, 0, 1]", "[0, 1, 1]"))
    with pytest.raises(InputError, match=r"it topples; it rests with.*\[-?0.00, -?0.00, 1.00\]"):
        load_object("mug", catalogue=read_catalogue(mug))


def test_another_mass_and_friction() -> None:
    can = load_object("ycbv-4")
    heavy = with_physics(can, mass_kg=2 * can.mass_kg, friction=0.3)
    np.testing.assert_allclose(heavy.inertia, 2 * can.inertia)
    assert (heavy.mass_kg, heavy.friction) == (2 * can.mass_kg, 0.3)
    assert with_physics(can).friction == can.friction
    with pytest.raises(InputError, match="mass"):
        with_physics(can, mass_kg=0.0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass_kg = 0.3", "mass_kg = 300", r"300 kg in .*is the mass in grams \(0.3 kg\)"),
        (
            "{ pieces = 1 }",
            "{ primitives = [{ kind = 'cylinder', size_m = [35, 45] }] }",
            "collision primitives are 70 x 70 x 90 m large, .*in millimetres",
        ),
    ],
)
def test_numbers_of_an_entry_that_contradict_its_mesh(
    mug: Path, old: str, new: str, message: str
) -> None:
    mug.write_text(mug.read_text().replace(old, new))
    with pytest.raises(InputError, match=message):
        load_object("mug", catalogue=read_catalogue(mug))


def _bop_entry(tmp_path: Path, scale: float, diameter: float) -> Path:
    """A catalogue of object 1 of a dataset ``kit``, whose models are written beside it."""
    models = tmp_path / "kit" / "models"
    models.mkdir(parents=True)
    body = trimesh.creation.cylinder(radius=35, height=90)
    body.apply_scale(scale).export(models / "obj_000001.ply")
    sides = {}
    for axis, mm in zip("xyz", (70.0, 70.0, 90.0), strict=True):
        length = mm * diameter / 114.0
        sides |= {f"min_{axis}": -length / 2, f"size_{axis}": length}
    (models / "models_info.json").write_text(json.dumps({"1": {"diameter": diameter, **sides}}))
    (tmp_path / "kit.toml").write_text(
        MUG.replace("mug]", "kit-1]").replace('mesh = "mug.stl"', 'dataset = "kit"\nobj_id = 1')
    )
    return tmp_path / "kit.toml"


def test_a_bop_model_fits_its_diameter(tmp_path: Path) -> None:
    catalogue = read_catalogue(_bop_entry(tmp_path, 1.0, 114.0))
    assert load_object("kit-1", catalogue=catalogue, bop_dirs={"kit": tmp_path / "kit"}).name


@pytest.mark.parametrize(
    ("scale", "diameter", "message"),
    [
        (1.0, 0.114, r"the median diameter is 0\.114 mm, but a hand grasps"),
        (1e-3, 0.114, "models of a BOP dataset are in millimetres; rescale it"),
    ],
)
def test_a_bop_model_in_another_unit(
    tmp_path: Path, scale: float, diameter: float, message: str
) -> None:
    catalogue = read_catalogue(_bop_entry(tmp_path, scale, diameter))
    with pytest.raises(InputError, match=message):
        load_object("kit-1", catalogue=catalogue, bop_dirs={"kit": tmp_path / "kit"})


def test_a_unit_of_a_bop_model_is_refused(tmp_path: Path) -> None:
    path = _bop_entry(tmp_path, 1e-3, 0.114)
    path.write_text(path.read_text().replace("obj_id = 1", 'obj_id = 1\nunit = "m"'))
    with pytest.raises(
        InputError, match=r"unit is 'm', but the models of a BOP dataset are in mil"
    ):
        read_catalogue(path)
