"""Coloured models of three solids."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from graspcast.bop.meshes import Mesh, write_mesh


def write_solid_models(folder: Path) -> Path:
    """Write the models of three solids whose sides have different colours, 60 to 160 mm long."""
    import trimesh

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
