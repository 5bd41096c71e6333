"""Parts as CAD makes them, metres, closed and with few triangles: plates, brackets, profiles."""

from __future__ import annotations

import numpy as np
import trimesh
from numpy import ndarray


def blocks(filled: ndarray, pitch: tuple[float, float, float]) -> trimesh.Trimesh:
    """The surface of the blocks of a grid that are filled, about the origin."""
    quads = []
    padded = np.pad(filled, 1)
    for axis in range(3):
        one, other = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
        for step in (1, -1):
            empty = ~np.roll(padded, -step, axis=axis)
            for cell in np.argwhere(padded & empty):
                low = cell + (np.eye(3, dtype=int)[axis] if step > 0 else 0)
                ring = [low, low + one, low + one + other, low + other]
                quads.append(ring if step > 0 else ring[::-1])
    corners = np.array(quads).reshape(-1, 3)
    unique, number = np.unique(corners, axis=0, return_inverse=True)
    quad = number.reshape(-1, 4)
    faces = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
    vertices = (unique - 1 - np.array(filled.shape) / 2) * np.array(pitch)
    return trimesh.Trimesh(vertices, faces, process=False)


def plate(holes: list[tuple[int, int]] = (), thickness: float = 0.003) -> trimesh.Trimesh:  # type: ignore[assignment]
    """A square plate of 90 mm with square holes of 10 mm, in cells of 9 x 9."""
    filled = np.ones((9, 9, 1), dtype=bool)
    for i, j in holes:
        filled[i, j] = False
    return blocks(filled, (0.01, 0.01, thickness))


def profile(thickness: float = 0.004) -> trimesh.Trimesh:
    """An L-profile of 40 x 60 x 80 mm, one edge of which is the z axis."""
    outline = [(0, 0), (0.04, 0), (0.04, 1), (1, 1), (1, 0.06), (0, 0.06)]
    points = np.array([[thickness if x == 1 else x for x in p] for p in outline])
    n = len(points)
    vertices = np.concatenate([np.c_[points, np.full(n, z)] for z in (0.0, 0.08)])
    caps = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)])
    ring = [(i, (i + 1) % n) for i in range(n)]
    sides = [f for i, j in ring for f in ((i, j, j + n), (i, j + n, i + n))]
    return trimesh.Trimesh(
        vertices, np.concatenate([caps[:, ::-1], caps + n, sides]), process=False
    )


def bracket() -> trimesh.Trimesh:
    """An angle bracket with a hole in each leg, of cells of 10 mm."""
    filled = np.zeros((6, 4, 5), dtype=bool)
    filled[:, :, 0] = True
    filled[0] = True
    filled[3:5, 1:3, 0] = False
    filled[0, 1:3, 2:4] = False
    return blocks(filled, (0.01, 0.01, 0.01))


def socket() -> trimesh.Trimesh:
    """A block of 70 mm with two blind pits."""
    filled = np.ones((7, 7, 4), dtype=bool)
    filled[1:3, 1:3, 2:] = False
    filled[4:6, 4:6, 2:] = False
    return blocks(filled, (0.01, 0.01, 0.01))


def housing() -> trimesh.Trimesh:
    """An open box of 72 mm with a hole in two of its walls, of cells of 8 mm."""
    filled = np.ones((9, 7, 5), dtype=bool)
    filled[1:-1, 1:-1, 1:] = False
    filled[[0, -1], 3, 2] = False
    return blocks(filled, (0.008, 0.008, 0.008))


def plug() -> trimesh.Trimesh:
    """A stepped plug of 50 mm along z, 40 and 24 mm in diameter."""
    outline = [(0, 0), (0.02, 0), (0.02, 0.025), (0.012, 0.025), (0.012, 0.05), (0, 0.05)]
    return trimesh.creation.revolve(outline, sections=48)


def tube(sections: int = 48) -> trimesh.Trimesh:
    """A tube of 60 mm in diameter, 10 mm thick and 60 mm long, along z."""
    return trimesh.creation.annulus(0.02, 0.03, 0.06, sections=sections)
