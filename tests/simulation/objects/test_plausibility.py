from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from graspcast.errors import InputError, MismatchError
from graspcast.pose.transforms import rotation_from_vector, transform
from graspcast.simulation.objects.plausibility import (
    check_density,
    check_diameter,
    check_grasp_is_near,
    check_primitives,
    describe_object,
)
from graspcast.simulation.objects.types import Grasp, GraspObject, Primitive

MUG = trimesh.creation.cylinder(radius=0.035, height=0.1, sections=64)
VERTICES, VOLUME = np.array(MUG.vertices), float(MUG.volume)


def mug(mass_kg: float = 0.31) -> GraspObject:
    return GraspObject(
        name="mug",
        vertices=VERTICES,
        faces=np.array(MUG.faces),
        pieces=(Primitive("cylinder", (0.035, 0.05), np.eye(4)),),
        mass_kg=mass_kg,
        friction=0.6,
        centroid=np.zeros(3),
        inertia=np.eye(3) * 1e-4,
        sim_T_ref=np.eye(4),
    )


@pytest.mark.parametrize("density", [25, 400, 1000, 19_300])
def test_a_density_that_exists(density: float) -> None:
    check_density("mug", density * VOLUME, VOLUME, 0.1)


@pytest.mark.parametrize(
    ("mass_kg", "scale", "remedy"),
    [
        (310.0, 1.0, r"is the mass in grams \(0.31 kg\)\?"),
        (0.31, 0.1, r"the mesh in centimetres, not in millimetres \(100 mm across\)"),
        (0.31, 1 / 25.4, r"the mesh in inches, not in millimetres \(100 mm across\)"),
        (0.31, 10.0, r"is the mesh in centimetres, not in .*\?|correct the mass"),
        (1e9, 1.0, "correct the mass or the mesh's unit"),
    ],
)
def test_a_density_that_does_not_exist(mass_kg: float, scale: float, remedy: str) -> None:
    with pytest.raises(InputError, match=r"kg in .* cm³ \(.*across\) are .* kg/m³") as problem:
        check_density("mug", mass_kg, VOLUME * scale**3, 0.1 * scale)
    assert problem.match(remedy)


def test_the_diameter_of_models_info_is_that_of_the_mesh() -> None:
    check_diameter("mug", VERTICES, 0.122)
    with pytest.raises(MismatchError, match=r"0\.122 mm, but its mesh is 100 mm .*in metres"):
        check_diameter("mug", VERTICES, 0.000122)
    with pytest.raises(MismatchError, match=r"12\.2 mm, but its mesh is 100 mm .*in centimetres"):
        check_diameter("mug", VERTICES, 0.0122)


def cylinder(radius: float, half: float, at: tuple[float, float, float] = (0, 0, 0)) -> Primitive:
    return Primitive("cylinder", (radius, half), transform(np.eye(3), np.array(at, dtype=float)))


@pytest.mark.parametrize(
    "pieces",
    [
        [cylinder(0.034, 0.051)],
        [cylinder(0.03, 0.01, (0, 0, z)) for z in (-0.04, 0, 0.04)],
        [Primitive("box", (0.03, 0.03, 0.045), np.eye(4))],
        [Primitive("sphere", (0.01,), transform(np.eye(3), np.array([0, 0, z])))
         for z in (-0.04, 0.04)] + [cylinder(0.03, 0.02)],
    ],
)  # fmt: skip
def test_primitives_about_as_large_as_the_mesh(pieces: list[Primitive]) -> None:
    check_primitives("mug", pieces, VERTICES)


@pytest.mark.parametrize(
    ("piece", "message"),
    [
        (cylinder(35.0, 50.0), r"70 x 70 x 100 m .* 70 x 70 x 100 mm; is size_m in millimetres"),
        (cylinder(3.5, 5.0), "size_m in centimetres"),
        (cylinder(0.035 / 0.0254, 0.05 / 0.0254), "size_m in inches"),
        (cylinder(0.07, 0.1), "half of each side .*are these whole sides"),
        (cylinder(0.035, 0.1), "half of each side .*are these whole sides"),
        (cylinder(0.000035, 0.00005), "make them about as large as the mesh"),
        (cylinder(0.035, 0.05, (0, 0, 0.5)), "is 0.50 m from that of its mesh"),
    ],
)
def test_primitives_that_are_another_size(piece: Primitive, message: str) -> None:
    with pytest.raises(MismatchError, match=message):
        check_primitives("mug", [piece], VERTICES)


def test_a_turned_primitive_is_as_large_as_it_looks() -> None:
    lying = transform(rotation_from_vector(np.array([0, np.pi / 2, 0])), np.zeros(3))
    with pytest.raises(MismatchError, match="100 x 20 x 20 mm large"):
        check_primitives("mug", [Primitive("cylinder", (0.01, 0.05), lying)], VERTICES)


def grasp(*position: float) -> Grasp:
    return Grasp(transform(np.eye(3), np.array(position)), "mug", "parallel")


@pytest.mark.parametrize("position", [(0, 0, 0.03), (0.2, 0, 0), (0, 0, -0.25)])
def test_a_grasp_at_its_object(position: tuple[float, ...]) -> None:
    check_grasp_is_near(grasp(*map(float, position)), mug())


@pytest.mark.parametrize(
    ("position", "message"),
    [
        ((0.0, 0.0, 30.0), "is 30 m away .* 100 mm across; is position_m in millimetres"),
        ((0.0, 0.0, 3.0), "is 2.95 m away .*in millimetres or centimetres, not"),
        ((0.0, 0.0, 1.2), "in millimetres or centimetres or inches"),
        ((0.0, 900.0, 0.0), "position_m is that of the tool centre point"),
    ],
)
def test_a_grasp_metres_from_its_object(position: tuple[float, ...], message: str) -> None:
    with pytest.raises(MismatchError, match=message):
        check_grasp_is_near(grasp(*position), mug())


def test_an_object_in_a_few_words() -> None:
    assert describe_object(mug()) == "100 mm, 0.31 kg, 807 kg/m³"
    assert describe_object(replace(mug(), faces=np.zeros((0, 3), dtype=np.int64))) == (
        "100 mm, 0.31 kg"
    )
