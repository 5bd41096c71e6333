"""Binary PLY files with triangles and quads together."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from graspcast.bop.meshes import read_coloured_mesh, read_mesh
from graspcast.bop.ply_polygons import with_triangles
from graspcast.errors import FormatError

CUBE = np.array([[x, y, z] for x in (0, 50) for y in (0, 50) for z in (0, 50)], np.float32)
FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7), (1, 7, 3)]


def ply(order: str = "<", *, colours: bool = False, texcoord: bool = False) -> bytes:
    """A cube of five quads and two triangles."""
    lines = [
        "ply",
        f"format binary_{'little' if order == '<' else 'big'}_endian 1.0",
        "comment made by hand",
        f"element vertex {len(CUBE)}",
        *(f"property float {axis}" for axis in "xyz"),
        f"element face {len(FACES)}",
        "property list uchar int vertex_indices",
        *(["property list uchar float texcoord"] if texcoord else []),
        *([f"property uchar {name}" for name in ("red", "green", "blue")] if colours else []),
        "end_header\n",
    ]
    body = CUBE.astype(f"{order}f4").tobytes()
    for i, face in enumerate(FACES):
        body += struct.pack(f"{order}B{len(face)}i", len(face), *face)
        body += struct.pack(f"{order}B{2 * len(face)}f", 2 * len(face), *face, *face) * texcoord
        body += bytes([200, i, 0]) * colours
    return "\n".join(lines).encode() + body


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("colours", [False, True])
@pytest.mark.parametrize("texcoord", [False, True])
def test_polygons_become_triangles(
    tmp_path: Path, order: str, colours: bool, texcoord: bool
) -> None:
    path = tmp_path / "mixed.ply"
    path.write_bytes(ply(order, colours=colours, texcoord=texcoord))
    mesh, painted = read_coloured_mesh(path)
    assert_allclose(mesh.vertices, CUBE / 1000, rtol=1e-6)
    assert_array_equal(read_mesh(path).faces, mesh.faces)
    corners = mesh.vertices[mesh.faces]
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    assert len(mesh.faces) == 12 and areas.sum() / 2 == pytest.approx(6 * 0.05**2)
    assert (painted[:, 0] == (200 if colours else 150)).all()


def test_what_cannot_be_rewritten_is_refused(tmp_path: Path) -> None:
    whole = ply()
    for content in (whole[:-1], whole[:60], b"", b"ply\nend_header\n", b"ply\nformat ascii 1.0\n"):
        assert with_triangles(content) is None
        (tmp_path / "m.ply").write_bytes(content)
        with pytest.raises(FormatError, match=r"m\.ply"):
            read_mesh(tmp_path / "m.ply")


def header(*lines: str) -> bytes:
    text = ("ply", "format binary_little_endian 1.0", *lines, "end_header\n")
    return "\n".join(text).encode()


@pytest.mark.parametrize(
    "content",
    [
        header("element vertex 5", "property float x") + bytes(8),  # ends too early
        header("element strip 1", "property list uchar int corners") + bytes(1),
        header("element vertex 1", "property float x") + bytes(4),  # no faces
        header("element face 1", "property list char int vertex_indices") + b"\xff",
        header("element vertex -1", "property float x"),
    ],
)
def test_elements_that_cannot_be_rewritten(content: bytes) -> None:
    assert with_triangles(content) is None
