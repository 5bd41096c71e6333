from __future__ import annotations

import numpy as np
import pytest
import trimesh

from cad_parts import bracket, plate, profile, tube
from graspcast.simulation.objects.surface import Surface
from graspcast.simulation.objects.symmetries import Symmetries, find_symmetries

create = trimesh.creation


def found(mesh: trimesh.Trimesh) -> Symmetries:
    return find_symmetries(Surface(np.array(mesh.vertices), np.array(mesh.faces)))


SOLIDS = {
    "box": (create.box((0.1, 0.06, 0.04)), 0, 3),
    "square bar": (create.box((0.008, 0.008, 0.18)), 0, 7),
    "cube": (create.box((0.05, 0.05, 0.05)), 0, 23),
    "cylinder": (create.cylinder(0.03, 0.1, sections=64), 1, 1),
    "hexagon": (create.cylinder(0.03, 0.04, sections=6), 0, 11),
    "cone": (create.cone(0.03, 0.08), 1, 0),
    "tube": (tube(), 1, 1),
    "plate": (plate(), 0, 7),
    "plate, a hole in a corner": (plate([(1, 1)]), 0, 1),
    "plate, holes in opposite corners": (plate([(1, 1), (7, 7)]), 0, 3),
    "plate, a hole beside a corner": (plate([(1, 2)]), 0, 0),
    "bracket": (bracket(), 0, 0),
}


FEW = ("box", "cylinder", "plate", "bracket")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n in FEW else pytest.mark.slow) for n in SOLIDS]
)
def test_symmetries_of_known_solids(name: str) -> None:
    mesh, continuous, discrete = SOLIDS[name]
    symmetries = found(mesh)
    assert (len(symmetries.continuous), len(symmetries.discrete)) == (continuous, discrete)


def test_a_mirrored_shape_is_no_symmetry() -> None:
    assert str(found(profile())) == "none"


@pytest.mark.slow
def test_a_ball_has_three_axes() -> None:
    ball = found(create.icosphere(4, 0.03))
    assert len(ball.continuous) == 3 and str(ball) == "any rotation (a ball)"


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["box", "cylinder", pytest.param("hexagon", marks=pytest.mark.slow)]
)
def test_a_turned_and_moved_solid_has_its_symmetries_about_its_own_middle(name: str) -> None:
    mesh, continuous, discrete = SOLIDS[name]
    moved = mesh.copy()
    pose = trimesh.transformations.random_rotation_matrix(np.array([0.3, 0.8, 0.1]))
    pose[:3, 3] = [0.03, 0.2, -0.1]
    moved.apply_transform(pose)
    symmetries = found(moved)
    assert (len(symmetries.continuous), len(symmetries.discrete)) == (continuous, discrete)
    for symmetric in symmetries.discrete:
        carried = symmetric @ pose @ [0, 0, 0, 1]
        np.testing.assert_allclose(carried[:3], pose[:3, 3], atol=2e-4)
    for axis in symmetries.continuous:
        assert abs(axis.axis @ pose[:3, 2]) > 0.9999
        beside = np.cross(axis.offset - pose[:3, 3], axis.axis)
        assert np.linalg.norm(beside) < 2e-4


@pytest.mark.slow
def test_axes_of_cad_are_exact_and_named() -> None:
    can = found(create.cylinder(0.03, 0.1, sections=64))
    assert can.continuous[0].axis.tolist() == [0, 0, 1]
    assert can.continuous[0].offset.tolist() == [0, 0, 0]
    assert str(can) == "any angle about z, 180° about x"
    assert str(found(plate())) == "7 rotations, 90° about z, 180° about x, 180° about y"


@pytest.mark.slow
def test_noise_of_a_scan_hides_no_symmetry_and_a_handle_breaks_it() -> None:
    can = create.cylinder(0.035, 0.1, sections=64).subdivide_to_size(0.01)
    noise = np.random.default_rng(0).normal(scale=3e-4, size=can.vertices.shape)
    scan = trimesh.Trimesh(can.vertices + noise, can.faces, process=False)
    assert len(found(scan).continuous) == 1
    handle = create.box((0.03, 0.01, 0.05))
    handle.apply_translation([0.045, 0, 0])
    mug = found(trimesh.util.concatenate([scan, handle]))
    assert not mug.continuous
    assert all(abs(pose[0, 0] - 1) < 0.01 for pose in mug.discrete)
