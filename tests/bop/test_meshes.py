"""Meshes of BOP models: PLY files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

from graspcast.bop.meshes import Mesh, read_coloured_mesh, read_mesh, write_mesh
from graspcast.errors import FormatError
from poses import write_models


def binary_ply(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    body = vertices.astype("<f4").tobytes()
    body += b"".join(b"\x03" + row.astype("<i4").tobytes() for row in faces)
    path.write_bytes(header.encode() + body)


def test_ascii_and_binary_meshes_are_the_same(tmp_path: Path) -> None:
    ascii_mesh = read_mesh(write_models(tmp_path) / "obj_000001.ply")
    assert_allclose(np.ptp(ascii_mesh.vertices, axis=0), [0.04, 0.06, 0.1])
    binary_ply(tmp_path / "b.ply", ascii_mesh.vertices * 1000, ascii_mesh.faces)
    binary_mesh = read_mesh(tmp_path / "b.ply")
    assert_allclose(binary_mesh.vertices, ascii_mesh.vertices, atol=1e-9)
    assert_array_equal(binary_mesh.faces, ascii_mesh.faces)


@pytest.mark.parametrize("content", [b"", b"ply\n", b"solid stl\n", b"\x00" * 50])
def test_what_is_no_mesh_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "m.ply"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=r"m\.ply"):
        read_mesh(path)


FACES = "3 0 1 2 255 0 0\n3 0 1 3 0 0 255\n"
CORNERS = "0 0 0\n10 0 0\n0 10 0\n0 0 10\n"


def test_colours_of_faces_are_averaged_at_the_vertices(tmp_path: Path) -> None:
    colours = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    path = tmp_path / "m.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 4\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face 2\nproperty list uchar int vertex_indices\n{colours}end_header\n"
        f"{CORNERS}{FACES}"
    )
    _, found = read_coloured_mesh(path)
    assert found[2].tolist() == [255, 0, 0] and found[3].tolist() == [0, 0, 255]
    assert found[0, 0] in (127, 128) and found[0, 2] in (127, 128)


@pytest.mark.parametrize("texture", ["missing", "no image", "truncated", "whole"])
def test_a_texture_that_cannot_be_read_is_told_where_colours_are_wanted(
    tmp_path: Path, texture: str, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "m.ply"
    rows = [f"{line} 0.5 0.5" for line in CORNERS.splitlines()]
    path.write_text(
        "ply\nformat ascii 1.0\ncomment TextureFile paint.png\nelement vertex 4\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property float texture_u\nproperty float texture_v\n"
        "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
        + "\n".join(rows)
        + "\n3 0 1 2\n3 0 1 3\n"
    )
    noise = np.random.default_rng(0).integers(200, 255, (64, 64, 3), dtype=np.uint8)
    Image.fromarray(noise).save(tmp_path / "paint.png")
    content = (tmp_path / "paint.png").read_bytes()
    kinds = {"no image": b"text", "truncated": content[:3000], "whole": content}
    if texture in kinds:
        (tmp_path / "paint.png").write_bytes(kinds[texture])
    else:
        (tmp_path / "paint.png").unlink()
    assert len(read_mesh(path).faces) == 2
    assert not caplog.records, "no colours are wanted"
    _, colours = read_coloured_mesh(path)
    said = [record.getMessage() for record in caplog.records]
    if texture == "whole":
        assert (colours >= 200).all() and not said
    else:
        assert len(said) == 1 and "its texture paint.png is not there" in said[0]
        assert (colours == 150).all()


def test_points_are_the_vertices_laid_out_for_compiled_loops() -> None:
    mesh = Mesh(np.random.default_rng(0).normal(size=(20, 3)), np.empty((0, 3), np.int64))
    assert_array_equal(mesh.points, mesh.vertices)
    assert mesh.points.T.flags.c_contiguous


def test_meshes_without_vertices_or_with_faces_beyond_them_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.ply"
    corners = np.array([[0.0, 0, 0], [50, 0, 0], [0, 50, 0]])
    binary_ply(path, corners, np.array([[0, 1, 3]]))
    with pytest.raises(FormatError, match="a face refers to a vertex beyond the 3 there are"):
        read_mesh(path)
    corners[1, 1] = np.nan
    binary_ply(path, corners, np.array([[0, 1, 2]]))
    with pytest.raises(FormatError, match="has no vertices, or some that are not finite numbers"):
        read_mesh(path)


def test_a_mesh_that_is_written_is_read_again(tmp_path: Path) -> None:
    corners = np.array([[0.0, 0, 0], [0.05, 0, 0], [0, 0.05, 0]])
    colours = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255]], np.uint8)
    write_mesh(tmp_path / "m.ply", Mesh(corners, np.array([[0, 1, 2]])), colours)
    mesh, painted = read_coloured_mesh(tmp_path / "m.ply")
    assert_allclose(mesh.vertices, corners, atol=1e-9)
    assert_array_equal(painted, colours)
