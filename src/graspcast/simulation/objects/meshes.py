"""Meshes of graspable objects (STL, OBJ, PLY or GLB, in a known unit) and their inertia."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.bop.meshes import Mesh, parse_mesh
from graspcast.errors import FormatError, InputError
from graspcast.io.reading import read_bytes
from graspcast.pose.lengths import METRES, fitting_units, shown, unit_problem
from graspcast.simulation.objects.plausibility import GRASPABLE
from graspcast.simulation.objects.types import ConvexPiece, Piece

__all__ = [
    "MESH_SUFFIXES",
    "MassProperties",
    "Unit",
    "mass_of_pieces",
    "mass_properties",
    "open_edges",
    "read_mesh",
    "read_mesh_and_unit",
]

_log = logging.getLogger(__name__)

Unit = Literal["auto", "mm", "cm", "m", "inch"]

_DETECTED = ("mm", "m")
MESH_SUFFIXES = (".stl", ".obj", ".ply", ".glb")
_VOLUME_TOLERANCE = 0.01


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Mass properties of a body of uniform density.

    Attributes
    ----------
    volume_m3
        Enclosed volume.
    centroid
        Centre of mass in the object's frame, metres.
    inertia
        Inertia tensor about the centroid, in the object's axes, kg m^2.
    """

    volume_m3: float
    centroid: Float[ndarray, " 3"]
    inertia: Float[ndarray, "3 3"]


def read_mesh(path: str | PathLike[str], unit: Unit = "auto", *, fixed: str = "") -> Mesh:
    """Read a triangle mesh into metres, with duplicate vertices merged and unused ones left out.

    Mesh files state no unit. ``"auto"`` chooses the one of millimetres and metres in which the
    object has a graspable size (5 mm to 1 m), and logs it at level INFO.

    Parameters
    ----------
    path
        The file.
    unit
        Its unit.
    fixed
        Why the unit cannot be another one, for the message if it does not fit; then the mesh is to
        be rescaled.

    Raises
    ------
    FormatError
        If the file cannot be read as a mesh or has no faces, or if the object has no graspable size
        in the given unit.
    """
    return read_mesh_and_unit(path, unit, fixed=fixed)[0]


def read_mesh_and_unit(
    path: str | PathLike[str], unit: Unit = "auto", *, fixed: str = ""
) -> tuple[Mesh, str]:
    """Read a triangle mesh as :func:`read_mesh` does; return the unit in which it was read, too."""
    path = Path(path)
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise FormatError(path, f"a mesh should end in {', '.join(MESH_SUFFIXES)}")
    vertices, faces = _load(path)
    # A vertex that no face uses, as scans have them, is not part of the surface.
    used, number = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], number.reshape(-1, 3)
    if not np.isfinite(vertices).all():
        raise FormatError(path, "has coordinates that are not finite numbers")
    chosen = _unit(path, float(np.ptp(vertices, axis=0).max()), unit, fixed)
    if unit == "auto":
        _log.info("%s: read as %s", path.name, chosen)
    # STL repeats every vertex, PLY those along texture seams; topology needs them once.
    vertices, number = np.unique(vertices, axis=0, return_inverse=True)
    faces = number.reshape(-1)[faces]
    degenerate = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    faces = faces[~degenerate]
    if not len(faces):
        raise FormatError(path, "every one of its triangles has two equal corners")
    return Mesh(vertices * METRES[chosen], faces), chosen


def _load(path: Path) -> tuple[ndarray, ndarray]:
    content = read_bytes(path)
    try:
        options: Any = {"skip_materials": True} if path.suffix.lower() == ".obj" else {}
        kind = path.suffix[1:].lower()
        # trimesh and NumPy warn about files that are then refused, or repaired below.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            loaded: Any = parse_mesh(content, kind, force="mesh", **options)
        vertices = np.array(loaded.vertices, dtype=np.float64)
        faces = np.array(getattr(loaded, "faces", ()), dtype=np.int64).reshape(-1, 3)
    except Exception as error:  # trimesh raises whatever its parser met
        raise FormatError(path, f"is not a {path.suffix[1:].upper()} mesh ({error})") from error
    if vertices.size and (vertices.ndim != 2 or vertices.shape[1] != 3):
        raise FormatError(path, "has vertices without three coordinates")
    if not len(vertices) or not len(faces):
        raise FormatError(path, "has no triangles; a grasp needs a surface, not a point cloud")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise FormatError(path, f"a face names a vertex beyond the {len(vertices)} there are")
    return vertices, faces


def _unit(path: Path, extent: float, unit: Unit, fixed: str) -> str:
    if unit == "auto":
        for detected in _DETECTED:
            if GRASPABLE.fits(extent * METRES[detected]):
                return detected
        others = [u for u in METRES if GRASPABLE.fits(extent * METRES[u])]
        as_others = " or ".join(f"unit = '{u}' ({shown(extent * METRES[u])})" for u in others)
        raise FormatError(
            path,
            f"is {extent:.3g} across, and {GRASPABLE.says}, so it is neither in millimetres nor in "
            f"metres; {f'give {as_others}, or ' if others else ''}rescale it",
        )
    if unit not in METRES:
        known = ", ".join(f"'{u}'" for u in METRES)
        raise FormatError(path, f"its unit {unit!r} should be {known} or 'auto'")
    across = extent * METRES[unit]
    if problem := unit_problem("its largest side", across, GRASPABLE, unit=unit):
        likely = fitting_units(across, GRASPABLE, unit=unit)
        remedy = f"{fixed}rescale it" if fixed or not likely else f"give unit = '{likely[0][0]}'"
        raise FormatError(path, f"{problem.removesuffix('?')}; {remedy}")
    return unit


def open_edges(faces: Int[ndarray, "f 3"]) -> tuple[Int[ndarray, "e 2"], Int[ndarray, " e"]]:
    """Return the edges at which a surface is not closed, and the number of faces at each.

    On a closed surface with consistent winding, the faces traverse each edge equally often in both
    directions. At the other edges, an odd number of faces means a hole and an even number means
    inconsistent winding.
    """
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    sign = np.where(directed[:, 0] < directed[:, 1], 1, -1)
    low, high = np.sort(directed, axis=1).T
    many = int(high.max(initial=0)) + 1
    # One number for each edge sorts faster than a pair.
    key, number, count = np.unique(low * many + high, return_inverse=True, return_counts=True)
    edges = np.stack([key // many, key % many], axis=-1)
    unbalanced = np.bincount(number.reshape(-1), weights=sign, minlength=len(edges)) != 0
    return edges[unbalanced], count[unbalanced]


def mass_properties(
    vertices: Float[ndarray, "v 3"], faces: Int[ndarray, "f 3"], mass_kg: float, what: str
) -> MassProperties:
    """Compute centroid and inertia of a body of uniform density from its surface.

    A few open edges of a scan are tolerated. A loop of length L bounds an area of at most L²/4π
    (isoperimetric inequality), so the error of the volume is at most twice the cone over the loop
    from the middle. Up to 1 % of the volume is accepted, and logged at level INFO.

    Parameters
    ----------
    vertices, faces
        The mesh, metres.
    mass_kg
        Mass.
    what
        The object's name in messages.

    Raises
    ------
    InputError
        If the surface is not closed, or its faces are inverted or inconsistently wound.
    """
    middle = (vertices[faces].min(axis=(0, 1)) + vertices[faces].max(axis=(0, 1))) / 2
    triangles = vertices[faces] - middle
    a, b, c = np.moveaxis(triangles, 1, 0)
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6
    edges, count = open_edges(faces)
    if len(edges):
        uncertain = _volume_uncertainty(vertices - middle, edges) / max(abs(volume), 1e-12)
        if uncertain > _VOLUME_TOLERANCE:
            holes = int((count % 2 == 1).sum())
            problem = (
                f"it is not watertight: {holes} edges are open"
                if holes
                else f"its faces are wound inconsistently at {len(edges)} edges"
            )
            raise InputError(
                f"{what}: {problem}, so its volume and inertia are undefined; close it and make "
                "its normals consistent (MeshLab, Blender, trimesh.repair)"
            )
        _log.info(
            "%s: %d edges are not closed; the error of the volume is at most %.2g %%",
            what,
            len(edges),
            100 * uncertain,
        )
    if volume <= 0:
        raise InputError(
            f"{what}: its faces are inverted (they enclose {volume * 1e6:.4g} cm³); flip the "
            "order of their corners"
        )
    return _integrated(triangles, middle, mass_kg, volume)


def mass_of_pieces(pieces: Sequence[Piece], mass_kg: float, what: str) -> MassProperties:
    """Compute centroid and inertia of a body from its convex pieces, which do not overlap.

    Parameters
    ----------
    pieces
        The pieces, no primitives.
    mass_kg, what
        As for :func:`mass_properties`.

    Raises
    ------
    InputError
        If they are primitives, which may overlap.
    """
    convex = [piece for piece in pieces if isinstance(piece, ConvexPiece)]
    if len(convex) < len(pieces):
        raise InputError(
            f"{what}: inertia = 'pieces' needs convex pieces, but its collision pieces are "
            "primitives, which may overlap",
            parameters=("catalogue",),
        )
    triangles = np.concatenate([piece.vertices[piece.faces] for piece in convex])
    middle = (triangles.min(axis=(0, 1)) + triangles.max(axis=(0, 1))) / 2
    triangles = triangles - middle
    a, b, c = np.moveaxis(triangles, 1, 0)
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6
    return _integrated(triangles, middle, mass_kg, volume)


def _integrated(
    triangles: Float[ndarray, "f 3 3"], middle: Float[ndarray, " 3"], mass_kg: float, volume: float
) -> MassProperties:
    from trimesh.triangles import mass_properties as integrate

    integral = integrate(triangles, density=mass_kg / volume)
    return MassProperties(
        volume_m3=volume,
        centroid=np.asarray(integral["center_mass"]) + middle,
        inertia=np.asarray(integral["inertia"]),
    )


def _volume_uncertainty(vertices: Float[ndarray, "v 3"], edges: Int[ndarray, "e 2"]) -> float:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    n = len(vertices)
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n))
    _, component = connected_components(graph, directed=False)
    loop = component[edges[:, 0]]
    length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    perimeter = np.bincount(loop, weights=length)
    height = np.linalg.norm(vertices, axis=1).max()
    return float(2 * (perimeter**2).sum() / (4 * np.pi) * height / 3)
