from __future__ import annotations

import numpy as np
import pytest
import trimesh

from cad_parts import profile
from graspcast.bop.meshes import Mesh
from graspcast.simulation.objects.frames import frame_difference


def moved(matrix: np.ndarray | None = None, scale: float = 1.0) -> Mesh:
    part = profile()
    if matrix is not None:
        part.apply_transform(matrix)
    part.apply_scale(scale)
    return Mesh(np.array(part.vertices), np.array(part.faces))


def test_the_same_mesh() -> None:
    assert frame_difference(moved(), moved()) == ""


@pytest.mark.slow
def test_another_origin() -> None:
    shift = trimesh.transformations.translation_matrix([0, 0, 0.051])
    said = frame_difference(moved(shift), moved())
    assert said == "the same shape, moved by (0, 0, 51) mm"


@pytest.mark.slow
def test_other_axes() -> None:
    quarter = trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0])
    assert (
        frame_difference(moved(quarter), moved()) == "the same shape, turned by 90° about (1, 0, 0)"
    )
    skew = trimesh.transformations.rotation_matrix(0.4, [1, 2, 0.5])
    assert "turned by 22.9° about" in frame_difference(moved(skew), moved())


@pytest.mark.parametrize(("scale", "unit"), [(1000.0, "metres"), (0.1, "millimetres")])
def test_another_unit(scale: float, unit: str) -> None:
    said = frame_difference(moved(scale=scale), moved())
    assert "across, not 108 mm; is it in" in said and unit in said


@pytest.mark.slow
def test_another_shape() -> None:
    box = trimesh.creation.box((0.04, 0.06, 0.08))
    said = frame_difference(Mesh(np.array(box.vertices), np.array(box.faces)), moved())
    assert said.startswith("another shape (up to")
