"""Object meshes of a BOP dataset: PLY, ASCII or binary, in millimetres."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.bop.units import metres
from graspcast.errors import FormatError

__all__ = ["Mesh", "read_mesh"]


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh in the object's frame.

    Attributes:
        vertices: Metres, (v, 3), in the file's order; nothing is merged.
        faces: Vertex numbers, (f, 3); empty for a point cloud.
    """

    vertices: Float[ndarray, "v 3"]
    faces: Int[ndarray, "f 3"]


def read_mesh(path: str | PathLike[str]) -> Mesh:
    """Read a BOP model (PLY in millimetres) into metres.

    Raises:
        FormatError: if the file cannot be read as PLY, or has no finite vertices.
    """
    import trimesh

    path = Path(path)
    try:
        with path.open("rb") as stream:
            loaded: Any = trimesh.load(stream, file_type="ply", process=False)
        vertices = np.array(loaded.vertices, dtype=np.float64)
        faces = np.array(getattr(loaded, "faces", np.empty((0, 3))), dtype=np.int64)
    except OSError as error:
        raise FormatError(path, f"cannot be read ({error.strerror})") from error
    except Exception as error:  # trimesh raises whatever its parser met
        raise FormatError(path, f"is not a PLY mesh ({error})") from error
    if len(vertices) == 0 or vertices.ndim != 2 or not np.isfinite(vertices).all():
        raise FormatError(path, "has no vertices, or some that are not finite numbers")
    faces = faces.reshape(-1, 3)
    if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise FormatError(path, f"a face names a vertex beyond the {len(vertices)} there are")
    return Mesh(vertices=metres(vertices), faces=faces)
