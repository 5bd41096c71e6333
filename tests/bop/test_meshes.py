"""Meshes of BOP models: PLY files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from graspcast.bop.meshes import read_mesh
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
