"""Colours of a mesh file are carried into the BOP model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from graspcast.bop.meshes import read_coloured_mesh
from graspcast.errors import MismatchError
from graspcast.simulation.objects.adding import write_objects
from graspcast.simulation.objects.colours import read_colours
from graspcast.simulation.objects.meshes import read_mesh_and_unit
from graspcast.simulation.objects.new_object import Told, make_object


def coloured_box(path: Path) -> None:
    """A box whose colour tells where a vertex is: red from x, green from y, blue from z."""
    box = trimesh.creation.box((60, 80, 100))
    box.visual.vertex_colors = np.where(box.vertices > 0, 255, 0).astype(np.uint8)
    box.export(path)


def test_colours_of_vertices_come_with_the_model(tmp_path: Path) -> None:
    coloured_box(tmp_path / "box.ply")
    new = make_object(tmp_path / "box.ply", "kit", 3, Told(density=500.0))
    write_objects([new], tmp_path / "kit", bop_models=False)
    mesh, colours = read_coloured_mesh(tmp_path / "kit" / "models" / "obj_000003.ply")
    np.testing.assert_array_equal(colours, np.where(mesh.vertices > 0, 255, 0))
    # Again it is the same; in other colours it is another model.
    assert write_objects([new], tmp_path / "kit", bop_models=False) == ["unchanged"]
    assert new.colours is not None
    other = replace(new, colours=255 - new.colours)
    with pytest.raises(MismatchError, match="the same mesh in other colours"):
        write_objects([other], tmp_path / "kit", bop_models=False)
    write_objects([other], tmp_path / "kit", bop_models=False, replace=True)
    _, colours = read_coloured_mesh(tmp_path / "kit" / "models" / "obj_000003.ply")
    np.testing.assert_array_equal(colours, np.where(mesh.vertices > 0, 0, 255))


def test_a_texture_is_read_at_the_vertices(tmp_path: Path) -> None:
    # The left half of the texture is red, the right one blue; x is the texture's axis.
    pixels = np.zeros((8, 8, 3), dtype=np.uint8)
    pixels[:, :4, 0], pixels[:, 4:, 2] = 200, 200
    box = trimesh.creation.box((60, 80, 100))
    uv = np.column_stack([np.where(box.vertices[:, 0] > 0, 0.9, 0.1), np.full(8, 0.5)])
    box.visual = trimesh.visual.TextureVisuals(uv=uv, image=Image.fromarray(pixels))
    box.export(tmp_path / "box.glb")
    box.export(tmp_path / "box.obj")
    for name in ("box.glb", "box.obj"):
        mesh, unit = read_mesh_and_unit(tmp_path / name, "mm")
        colours = read_colours(tmp_path / name, mesh, unit)
        assert colours is not None
        right = mesh.vertices[:, 0] > 0
        np.testing.assert_array_equal(colours[right], np.tile([0, 0, 200], (4, 1)))
        np.testing.assert_array_equal(colours[~right], np.tile([200, 0, 0], (4, 1)))


def test_a_file_without_colours_gives_none(tmp_path: Path) -> None:
    for name in ("box.stl", "box.ply"):
        trimesh.creation.box((60, 80, 100)).export(tmp_path / name)
        mesh, unit = read_mesh_and_unit(tmp_path / name)
        assert read_colours(tmp_path / name, mesh, unit) is None
