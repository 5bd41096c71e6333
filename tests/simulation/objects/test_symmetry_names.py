from __future__ import annotations

import numpy as np
import pytest
import trimesh

from graspcast.errors import InputError
from graspcast.simulation.objects.surface import Surface
from graspcast.simulation.objects.symmetry_names import stated_symmetries

CAN = trimesh.creation.cylinder(0.03, 0.1, sections=64)
BOX = trimesh.creation.box((0.1, 0.06, 0.04))


def stated(mesh: trimesh.Trimesh, *names: str) -> tuple[str, str]:
    symmetries, doubt = stated_symmetries(
        Surface(np.array(mesh.vertices), np.array(mesh.faces)), names
    )
    return str(symmetries), doubt


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("none",), "none"),
        (("z",), "any angle about z"),
        (("z", "x2"), "any angle about z, 180° about x"),
        (("z4",), "90° about z"),
        (("x2", "y2"), "180° about x, 180° about y, 180° about z"),
        pytest.param(("x", "y", "z"), "any rotation (a ball)", marks=pytest.mark.slow),
    ],
)
def test_names(names: tuple[str, ...], said: str) -> None:
    assert stated(CAN, *names)[0] == said


@pytest.mark.slow
def test_a_doubt_where_the_shape_says_otherwise() -> None:
    assert stated(CAN, "z", "x2")[1] == ""
    assert stated(BOX, "z2")[1] == ""
    doubt = stated(BOX, "z4")[1]
    assert "does not have the stated symmetry" in doubt and "mm" in doubt


@pytest.mark.parametrize("names", [("q",), ("z1",), ("z99",), ("auto", "z"), ("none", "x2")])
def test_unknown_names(names: tuple[str, ...]) -> None:
    with pytest.raises(InputError, match="auto or none alone"):
        stated(CAN, *names)


def test_turns_that_are_no_group_with_an_axis() -> None:
    with pytest.raises(InputError, match="a half turn across it"):
        stated(CAN, "z", "x4")
