from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from cad_parts import bracket, plate, profile, tube
from graspcast.errors import GraspcastError
from graspcast.simulation.objects.new_object import NewObject, Told, make_object

BOX = trimesh.creation.box((40.0, 60, 100))


def made(path: Path, mesh: trimesh.Trimesh, **told: Any) -> NewObject:
    mesh.export(path)
    told = {"density": 1000.0, **told}
    if told.get("mass_kg") is not None:
        told["density"] = None
    return make_object(path, "kit", 7, Told(**told))


def refused(path: Path, mesh: trimesh.Trimesh, **told: Any) -> str:
    with pytest.raises(GraspcastError) as error:
        made(path, mesh, **told)
    return str(error.value)


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "glb"])
@pytest.mark.parametrize(("unit", "scale"), [("mm", 1.0), ("m", 1e-3)])
def test_every_format_and_unit_gives_the_same_object(
    tmp_path: Path, suffix: str, unit: str, scale: float
) -> None:
    mesh = BOX.copy()
    mesh.apply_translation([0, 0, 50])
    mesh.apply_scale(scale)
    new = made(tmp_path / f"box.{suffix}", mesh, mass_kg=0.3)
    assert new.unit == unit and new.entry.name == "kit-7" and new.entry.label == "box"
    assert new.entry.mass_kg == 0.3 and new.entry.up == (0, 0, 1)
    low, high = new.mesh.vertices.min(axis=0), new.mesh.vertices.max(axis=0)
    np.testing.assert_allclose([low, high], [[-0.02, -0.03, 0], [0.02, 0.03, 0.1]], atol=1e-7)
    thing = new.grasp_object
    np.testing.assert_allclose(thing.centroid, [0, 0, 0.05], atol=1e-7)
    sides = np.array([0.04, 0.06, 0.1]) ** 2
    np.testing.assert_allclose(np.diag(thing.inertia), 0.3 / 12 * (sides.sum() - sides), rtol=1e-5)
    assert str(new.symmetries) == "180° about x, 180° about y, 180° about z"


def test_density_gives_the_mass_and_says_from_what(tmp_path: Path) -> None:
    entry = made(tmp_path / "box.stl", BOX, density=500.0).entry
    assert entry.mass_kg == pytest.approx(0.12)
    assert entry.mass_source == "500 kg/m³ in 240 cm³"


@pytest.mark.slow
def test_a_part_that_does_not_stand_lies_as_it_does_and_that_is_said(tmp_path: Path) -> None:
    rod = trimesh.creation.cylinder(4.0, 120.0)
    rod.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1, 0, 0]))
    new = made(tmp_path / "rod.stl", rod)
    assert "does not stand with z up" in new.remarks[0]
    assert new.grasp_object.sim_T_ref[2, 3] < 0.01
    assert "topples" in refused(tmp_path / "rod.stl", rod, up=(0.0, 0.0, 1.0))


@pytest.mark.slow
def test_a_part_with_y_up_is_told_so(tmp_path: Path) -> None:
    cone = trimesh.creation.cone(50.0, 70.0)
    cone.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    (said,) = made(tmp_path / "cone.stl", cone).remarks
    assert said.endswith("it would also stand with y up")


@pytest.mark.parametrize("told", [{"mass_kg": 2.4}, {"mass_kg": None, "density": 10_000.0}])
def test_an_object_denser_than_copper_is_asked_about(tmp_path: Path, told: dict[str, Any]) -> None:
    (said,) = made(tmp_path / "box.stl", BOX, **told).remarks
    assert "10,000 kg/m³ are more than those of steel" in said


@pytest.mark.parametrize("thickness", [0.0005, pytest.param(0.003, marks=pytest.mark.slow)])
@pytest.mark.parametrize("part", [plate, pytest.param(profile, marks=pytest.mark.slow)])
def test_collision_pieces_of_thin_parts_are_as_thin(
    tmp_path: Path, part: Any, thickness: float
) -> None:
    new = made(tmp_path / "part.stl", part(thickness=thickness))
    assert new.collision.sticks_out_m < 2e-4
    assert min(np.ptp(p.vertices, axis=0).min() for p in new.collision.pieces) < 1.2 * thickness


@pytest.mark.slow
def test_a_hollow_is_measured(tmp_path: Path) -> None:
    hull = made(tmp_path / "tube.stl", tube(), pieces=1)
    assert hull.collision.sticks_out_m == pytest.approx(0.02, abs=0.005)
    assert "1 piece, up to" in str(hull.collision)
    assert made(tmp_path / "bracket.stl", bracket(), pieces=4).collision.sticks_out_m < 0.03


def test_meshes_that_are_no_single_solid(tmp_path: Path) -> None:
    opened = BOX.copy()
    opened.update_faces(np.arange(12) > 1)
    path = tmp_path / "box.ply"
    assert "not watertight: 4 edges are open" in refused(path, opened)
    inverted = BOX.copy()
    inverted.invert()
    assert "inverted" in refused(path, inverted)
    assert "inverted" in refused(path, inverted, open_mesh=True)
    other = BOX.copy()
    other.apply_translation([200.0, 0, 0])
    assert "has 2 bodies, and one of 100 mm lies 160 mm apart" in refused(
        path, trimesh.util.concatenate([BOX, other])
    )
    flat = trimesh.creation.box((40.0, 60, 0))
    triangle = trimesh.Trimesh([[0, 0, 0], [50, 0, 0], [0, 50, 0]], [[0, 1, 2]])
    for mesh in (flat, triangle):
        assert "is flat" in refused(path, mesh)
    for size in (1e-5, 1e5):
        assert "neither in millimetres nor in metres" in refused(
            path, trimesh.creation.box((size, size, size))
        )


def test_an_open_mesh_is_accepted_if_told_with_the_volume_of_its_pieces(tmp_path: Path) -> None:
    opened = BOX.copy()
    opened.update_faces(np.arange(12) > 1)
    new = made(tmp_path / "box.ply", opened, open_mesh=True)
    assert new.entry.inertia == "pieces" and new.entry.mass_kg == pytest.approx(0.24)
    assert "4 edges are open; volume and inertia are of its collision pieces" in new.remarks[0]


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"mass_kg": 0.0}, "mass is 0.0 kg"),
        ({"mass_kg": float("nan")}, "mass is nan kg"),
        ({"mass_kg": 310.0}, "is the mass in grams"),
        ({"density": None}, "neither is given"),
        ({"density": float("nan")}, "density is nan"),
        ({"density": 2.7}, "is it in g/cm³?"),
        ({"friction": float("nan")}, "friction is nan"),
        ({"friction": 30.0}, "between 0.05 .* and 3"),
        ({"up": (0.0, 0.0, 0.0)}, "is zero or not finite"),
        ({"symmetry": ("q",)}, "the symmetry 'q'"),
    ],
)
def test_numbers_out_of_range(tmp_path: Path, told: dict[str, Any], said: str) -> None:
    import re

    assert re.search(said, refused(tmp_path / "box.stl", BOX, **told))


def test_the_unit_is_asked_for_where_nothing_tells_it(tmp_path: Path) -> None:
    inches = trimesh.creation.box((5.0, 6, 7))
    path = tmp_path / "part.stl"
    said = refused(path, inches)
    assert "7 mm across if it is in millimetres, but may be in centimetres (70 mm)" in said
    assert made(path, inches, unit="inch").entry.mass_kg == pytest.approx(3.441, abs=0.001)
    assert "the mesh in centimetres" in refused(path, inches, mass_kg=0.3)


def test_a_far_origin_is_said(tmp_path: Path) -> None:
    far = BOX.copy()
    far.apply_translation([300.0, 0, 0])
    assert "the origin of its frame is 280 mm outside" in made(tmp_path / "a.stl", far).remarks[0]
