"""Models of three solids, and a renderer of them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from graspcast.bop.meshes import Mesh, write_mesh
from graspcast.errors import GraspcastError
from graspcast.rendering.opengl_context import open_context
from graspcast.rendering.synthetic.camera import INTRINSICS
from graspcast.rendering.synthetic.dataset import read_models
from graspcast.rendering.synthetic.renderer import Renderer
from graspcast.rendering.synthetic.tabletop import Tabletop


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three solids whose sides have different colours, 60 to 160 mm long."""
    import trimesh

    try:
        open_context(8, 8).free()
    except GraspcastError as error:
        pytest.skip(f"no OpenGL here: {error}")
    folder = tmp_path_factory.mktemp("solids") / "models"
    info = {}
    solids = {
        1: trimesh.creation.box((0.06, 0.10, 0.16)),
        4: trimesh.creation.cylinder(0.03, 0.12),
        7: trimesh.creation.annulus(0.02, 0.05, 0.06),
    }
    for obj_id, solid in solids.items():
        solid = solid.subdivide_to_size(0.01)
        vertices = np.array(solid.vertices) + [0.01 * obj_id, 0.0, 0.02]
        colours = np.rint(255 * (vertices - vertices.min(0)) / np.ptp(vertices, 0)).astype(np.uint8)
        write_mesh(folder / f"obj_{obj_id:06d}.ply", Mesh(vertices, solid.faces), colours)
        low, size = 1e3 * vertices.min(axis=0), 1e3 * np.ptp(vertices, axis=0)
        info[obj_id] = {"diameter": float(np.linalg.norm(size))}
        info[obj_id] |= {f"min_{a}": x for a, x in zip("xyz", low, strict=True)}
        info[obj_id] |= {f"size_{a}": x for a, x in zip("xyz", size, strict=True)}
    (folder / "models_info.json").write_text(json.dumps(info))
    return folder


@pytest.fixture(scope="module")
def renderer(models: Path) -> Iterator[Renderer]:
    tabletop = Tabletop(read_models(models), width=1280, height=960)
    with Renderer(tabletop, INTRINSICS) as made:
        yield made
