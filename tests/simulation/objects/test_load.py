from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

from graspcast.errors import ExtraMissingError, FormatError, InputError, UnknownNameError
from graspcast.pose.transforms import quaternion, rotation_angle, rotation_from_quaternion
from graspcast.simulation.objects.catalogue import read_catalogue
from graspcast.simulation.objects.decomposition import Decomposition
from graspcast.simulation.objects.load import load_mesh, load_object, with_physics
from graspcast.simulation.objects.rest_pose import rest_pose, stable_ups
from graspcast.simulation.objects.types import ConvexPiece, GraspObject, Primitive

NAMES = list(read_catalogue())
MUG = """
[objects.mug]
label = "my mug"
mesh = "mug.stl"
mass_kg = 0.3
mass_source = "scales"
friction = 0.6
friction_source = "a guess"
up = [0, 0, 1]
collision = { pieces = 1 }
"""


@pytest.fixture
def mug(tmp_path: Path) -> Path:
    trimesh.creation.cylinder(radius=35, height=90).export(tmp_path / "mug.stl")
    (tmp_path / "mine.toml").write_text(MUG)
    return tmp_path / "mine.toml"


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


def test_the_catalogue_has_the_papers_objects_with_their_sources() -> None:
    catalogue = read_catalogue()
    expected = {f"lmo-{i}" for i in (1, 5, 6, 8, 9, 10, 11, 12)}
    expected |= {f"ycbv-{i}" for i in (2, 3, 4, 5, 8, 9, 12)}
    assert set(catalogue) == expected
    for name, entry in catalogue.items():
        assert name == f"{entry.dataset}-{entry.obj_id}"
        assert (entry.ycb is not None) == (entry.dataset == "ycbv")
        assert entry.mass_source and entry.friction_source
        assert entry.dataset == "ycbv" or entry.mass_source.startswith("estimated")


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


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass_kg = 0.3", "mass_kg = 0", r"objects.mug: mass_kg is 0.0, and must be .* above zero"),
        ("friction = 0.6", "friction = -1", "friction is -1.0"),
        ("friction = 0.6", "friction = nan", "friction is nan"),
        ("mass_kg = 0.3", "mass_kg = 'heavy'", "mass_kg should be a number, not 'heavy'"),
        ("mass_kg = 0.3", "", "mass_kg is missing"),
        ("mass_kg = 0.3", "mass_kg = 0.3\nmas = 1", r"unknown key 'mas' \(did you mean"),
        ('mesh = "mug.stl"', "", "mesh is missing; name a file, or a dataset"),
        ("up = [0, 0, 1]", "up = [0, 1]", "up should be 3 finite numbers"),
        ("pieces = 1", "pieces = 0", "collision: a collision shape needs at least one piece"),
        ("pieces = 1", "piece = 1", "unknown key 'piece'"),
        ("pieces = 1", "primitives = []", "primitives is empty"),
        ("pieces = 1", "primitives = [{kind='cone', size_m=[1]}]", "kind is 'cone'; known: box"),
        ("pieces = 1", "primitives = [{kind='box', size_m=[1, 2]}]", "size_m should be 3"),
        ("pieces = 1", "primitives = [{kind='sphere', size_m=[0]}]", "size_m is"),
        ("[objects.mug]", "[object.mug]", r"has no \[objects.NAME\] table"),
        ("[objects.mug]", "[objects.mug", "is not TOML"),
    ],
)
def test_a_catalogue_that_is_wrong(mug: Path, old: str, new: str, message: str) -> None:
    mug.write_text(MUG.replace(old, new))
    with pytest.raises(FormatError, match=message):
        read_catalogue(mug)


def test_a_direction_in_which_it_topples_lists_those_in_which_it_rests(mug: Path) -> None:
    mug.write_text(MUG.replace("[0, 0, 1]", "[0, 1, 1]"))
    with pytest.raises(InputError, match=r"it topples; it rests with.*\[-?0.00, -?0.00, 1.00\]"):
        load_object("mug", catalogue=read_catalogue(mug))


def test_up_need_not_be_exact() -> None:
    box = (Primitive("box", (0.02, 0.03, 0.05), np.eye(4)),)
    straight = rest_pose(box, np.zeros(3), np.array([0, 0, 1.0]), "box")
    np.testing.assert_allclose(straight[2], [0, 0, 1, 0.05], atol=1e-9)
    lying = rest_pose(box, np.zeros(3), np.array([1.0, 0.1, -0.2]), "box")
    np.testing.assert_allclose(lying[2], [1, 0, 0, 0.02], atol=1e-9)


@pytest.mark.parametrize(
    ("piece", "height"),
    [
        (Primitive("cylinder", (0.03, 0.05), np.eye(4)), 0.05),
        (Primitive("sphere", (0.03,), np.eye(4)), 0.03),
        (Primitive("box", (0.01, 0.02, 0.03), np.eye(4)), 0.03),
    ],
)
def test_primitives_touch_the_table_exactly(piece: Primitive, height: float) -> None:
    pose = rest_pose((piece,), np.zeros(3), np.array([0, 0, 1.0]), "it")
    assert pose[2, 3] == pytest.approx(height, rel=1e-9)


def test_a_body_heavy_at_one_end_does_not_stand_on_the_other() -> None:
    box = (Primitive("box", (0.02, 0.02, 0.05), np.eye(4)),)
    ups, heights = stable_ups(box, np.array([0.0, 0.0, -0.04]))
    assert heights.min() == pytest.approx(0.01)
    # Its centroid leans beyond the base, so it cannot stand on that face.
    ups, _ = stable_ups(box, np.array([0.05, 0.0, 0.0]))
    assert not (ups @ [0, 0, 1] > 0.9).any()


def test_another_mass_and_friction() -> None:
    can = load_object("ycbv-4")
    heavy = with_physics(can, mass_kg=2 * can.mass_kg, friction=0.3)
    np.testing.assert_allclose(heavy.inertia, 2 * can.inertia)
    assert (heavy.mass_kg, heavy.friction) == (2 * can.mass_kg, 0.3)
    assert with_physics(can).friction == can.friction
    with pytest.raises(InputError, match="mass"):
        with_physics(can, mass_kg=0.0)
