"""Object meshes of a BOP dataset: PLY, ASCII or binary, in millimetres."""

from __future__ import annotations

import io
import logging
from contextlib import suppress
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy import ndarray

from graspcast.bop.ply_polygons import with_triangles
from graspcast.bop.units import metres, millimetres
from graspcast.errors import FormatError
from graspcast.io.cached import cached_property
from graspcast.io.files import atomic_write
from graspcast.io.reading import read_bytes

__all__ = [
    "Mesh",
    "load_with_colours",
    "parse_mesh",
    "read_coloured_mesh",
    "read_mesh",
    "write_mesh",
]

_log = logging.getLogger(__name__)

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

    @cached_property
    def points(self) -> Float[ndarray, "v 3"]:
        """The vertices, all x, then all y and z in memory, as compiled loops want them."""
        return np.asfortranarray(self.vertices)

    @property
    def stray(self) -> int:
        """The number of vertices that no face uses; none for a point cloud."""
        return len(self.vertices) - len(np.unique(self.faces)) if len(self.faces) else 0

    def without_stray(self) -> Mesh:
        """Return the mesh without vertices that no face uses; a point cloud as it is."""
        if not self.stray:
            return self
        used, faces = np.unique(self.faces, return_inverse=True)
        return Mesh(self.vertices[used], faces.reshape(-1, 3).astype(np.int64))

    def __repr__(self) -> str:
        return f"Mesh({len(self.vertices)} vertices, {len(self.faces)} faces)"


def read_mesh(path: str | PathLike[str]) -> Mesh:
    """Read a BOP model (PLY in millimetres) into metres.

    Raises
    ------
    FormatError
        If the file cannot be read as PLY, or has no finite vertices.
    """
    return _mesh(Path(path), _load(Path(path), skip_materials=True))


def read_coloured_mesh(path: str | PathLike[str]) -> tuple[Mesh, UInt8[ndarray, "v 3"]]:
    """Read a BOP model with the RGB colour of each vertex; grey if it has none.

    The colours are those of :func:`load_with_colours`.

    Raises
    ------
    FormatError
        As :func:`read_mesh`.
    """
    path = Path(path)
    loaded, colours = load_with_colours(path)
    mesh = _mesh(path, loaded)
    if colours is None:
        colours = np.full(mesh.vertices.shape, _GREY, dtype=np.uint8)
    return mesh, colours


def load_with_colours(
    path: Path, kind: str = "ply", **options: Any
) -> tuple[Any, UInt8[ndarray, "v 3"] | None]:
    """Load a mesh file with trimesh, and the RGB colour of each of its vertices.

    The colours are the file's vertex colours, the means of its face colours at each vertex, or
    those of its texture at each vertex; None if it has none, or, which is logged as a warning, a
    texture that cannot be read.

    Parameters
    ----------
    path
        The file; textures are beside it.
    kind
        What kind of file it is.
    **options
        Passed on to ``trimesh.load``.

    Raises
    ------
    FormatError
        If the file cannot be read.
    """
    import trimesh

    named: list[str] = []

    class Textures(trimesh.resolvers.FilePathResolver):
        def get(self, name: str) -> Any:
            named.append(name)
            return super().get(name)

    unread: list[str] = []

    def is_no_warning(record: logging.LogRecord) -> bool:
        if record.levelno >= logging.WARNING:
            unread.append(record.getMessage())
        return record.levelno < logging.WARNING

    # trimesh logs a traceback where it cannot read a texture, and goes on with a grey one.
    log = logging.getLogger("trimesh.util")
    log.addFilter(is_no_warning)
    try:
        loaded = _load(path, kind, resolver=Textures(str(path)), **options)
    finally:
        log.removeFilter(is_no_warning)
    painted = getattr(getattr(loaded, "visual", None), "kind", None) == "texture"
    count = len(getattr(loaded, "vertices", ()))
    colours = None if painted and unread else _colours(loaded, count)
    if colours is None and named:
        _log.warning(
            "%s: its texture %s is not there, or cannot be read; the object is drawn grey",
            path,
            named[0],
        )
    return loaded, colours


def _colours(loaded: Any, count: int) -> UInt8[ndarray, "v 3"] | None:
    """Return a loaded mesh's colours by vertex, None if it has none that can be read."""
    visual: Any = getattr(loaded, "visual", None)
    if not getattr(visual, "defined", False):  # point clouds lack the attribute
        return None
    try:
        # Those of faces are averaged.
        by_vertex = visual.to_color() if visual.kind == "texture" else visual
        colours = np.array(by_vertex.vertex_colors, dtype=np.uint8)
    except Exception:  # Pillow and trimesh raise many types
        return None
    return colours[:, :3] if colours.shape in ((count, 3), (count, 4)) else None


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


def parse_mesh(content: bytes, kind: str, **options: Any) -> Any:
    """Parse a mesh by trimesh, as it is; binary PLY files may mix triangles and other polygons.

    Parameters
    ----------
    content
        The file.
    kind
        Its suffix, without the dot.
    **options
        As for ``trimesh.load``.

    Raises
    ------
    Exception
        Whatever trimesh raises.
    """
    import trimesh

    def load(content: bytes) -> Any:
        return trimesh.load(io.BytesIO(content), file_type=kind, process=False, **options)

    try:
        return load(content)
    except Exception:
        # trimesh reads polygons in binary files if all have the same number of corners.
        triangles = with_triangles(content)
        with suppress(Exception):
            if triangles is not None:
                return load(triangles)
        raise


def _load(path: Path, kind: str = "ply", **options: Any) -> Any:
    content = read_bytes(path)
    try:
        return parse_mesh(content, kind, **options)
    except Exception as error:  # trimesh raises many types
        raise FormatError(path, f"is not a {kind.upper()} mesh ({error})") from error


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
