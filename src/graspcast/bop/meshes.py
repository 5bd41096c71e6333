"""Object meshes of a BOP dataset: PLY, ASCII or binary, in millimetres."""

from __future__ import annotations

import io
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy import ndarray

from graspcast.bop.units import metres, millimetres
from graspcast.errors import FormatError
from graspcast.io.files import atomic_write
from graspcast.io.reading import read_bytes

__all__ = ["Mesh", "read_coloured_mesh", "read_mesh", "write_mesh"]

_GREY = 150


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in the object's frame.

    Attributes
    ----------
    vertices
        Metres, (v, 3), in the file's order; no vertices are merged.
    faces
        Vertex indices, (f, 3); empty for a point cloud.
    """

    vertices: Float[ndarray, "v 3"]
    faces: Int[ndarray, "f 3"]

    def __repr__(self) -> str:
        return f"Mesh({len(self.vertices)} vertices, {len(self.faces)} faces)"


def read_mesh(path: str | PathLike[str]) -> Mesh:
    """Read a BOP model (PLY in millimetres) into metres.

    Raises
    ------
    FormatError
        If the file cannot be read as PLY, or has no finite vertices.
    """
    return _mesh(Path(path), _load(Path(path)))


def read_coloured_mesh(path: str | PathLike[str]) -> tuple[Mesh, UInt8[ndarray, "v 3"]]:
    """Read a BOP model with the RGB colour of each vertex.

    The colours are the file's vertex colours, or those of its texture at each vertex; grey if it
    has neither.

    Raises
    ------
    FormatError
        As :func:`read_mesh`.
    """
    path = Path(path)
    loaded = _load(path)
    mesh = _mesh(path, loaded)
    colours = np.full(mesh.vertices.shape, _GREY, dtype=np.uint8)
    visual: Any = getattr(loaded, "visual", None)
    if getattr(visual, "defined", False):  # point clouds lack the attribute
        colours[:] = (visual if visual.kind == "vertex" else visual.to_color()).vertex_colors[:, :3]
    return mesh, colours


def write_mesh(
    path: str | PathLike[str], mesh: Mesh, colours: UInt8[ndarray, "v 3"] | None = None
) -> None:
    """Write a mesh as a BOP model: binary PLY in millimetres, single precision."""
    import trimesh

    made: Any = trimesh.Trimesh(
        millimetres(mesh.vertices), mesh.faces, vertex_colors=colours, process=False
    )
    with atomic_write(path) as temporary:
        temporary.write_bytes(made.export(file_type="ply", vertex_normal=False))


def _load(path: Path) -> Any:
    import trimesh

    content = read_bytes(path)
    try:
        resolver = trimesh.resolvers.FilePathResolver(str(path))
        return trimesh.load(io.BytesIO(content), file_type="ply", process=False, resolver=resolver)
    except Exception as error:  # trimesh raises many types
        raise FormatError(path, f"is not a PLY mesh ({error})") from error


def _mesh(path: Path, loaded: Any) -> Mesh:
    try:
        vertices = np.array(loaded.vertices, dtype=np.float64)
        faces = np.array(getattr(loaded, "faces", np.empty((0, 3))), dtype=np.int64)
    except Exception as error:  # trimesh raises many types
        raise FormatError(path, f"is not a PLY mesh ({error})") from error
    if len(vertices) == 0 or vertices.ndim != 2 or not np.isfinite(vertices).all():
        raise FormatError(path, "has no vertices, or some that are not finite numbers")
    faces = faces.reshape(-1, 3)
    if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise FormatError(path, f"a face refers to a vertex beyond the {len(vertices)} there are")
    return Mesh(vertices=metres(vertices), faces=faces)
