"""Convex decomposition of a mesh into collision pieces, cached on disk."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.bop.models_writing import extreme_points
from graspcast.errors import FormatError, InputError
from graspcast.io.arrays import read_arrays, write_arrays
from graspcast.io.cache import cache_directory
from graspcast.io.hashing import canonical_json, sha256
from graspcast.simulation.objects.simplification import simplified
from graspcast.simulation.objects.types import ConvexPiece

__all__ = ["Decomposition", "convex_hull", "decompose"]

_log = logging.getLogger(__name__)

# Distances computed at once, a bound on memory.
_DISTANCES = 10_000_000
# Half of CoACD's own values: 3 to 7 times as fast, and no coarser where it was measured.
_SAMPLES, _SEARCH_NODES = 1000, 12


@dataclass(frozen=True)
class Decomposition:
    """Parameters of a convex decomposition.

    Attributes
    ----------
    pieces
        Largest number of pieces; 1 gives the convex hull.
    threshold
        CoACD's concavity below which a piece is not cut, for a mesh scaled to [-1, 1]. Lower is
        finer.
    preprocess_resolution
        CoACD's resolution for closing the mesh; raise it if thin parts are lost.
    search_iterations
        Iterations of CoACD's tree search per cut.
    seed
        Random seed of CoACD.
    hull_tolerance_m
        Largest distance of a mesh vertex from its simplified hull, metres.
    preprocess
        Whether CoACD closes the mesh first, which makes thin parts up to a 30th of the object
        thicker; without, this is done only for a mesh that is not closed.
    """

    pieces: int = 8
    threshold: float = 0.08
    preprocess_resolution: int = 30
    search_iterations: int = 60
    seed: int = 0
    hull_tolerance_m: float = 3e-4
    preprocess: bool = True

    def __post_init__(self) -> None:
        if self.pieces < 1:
            raise InputError(f"a collision shape needs at least one piece, not {self.pieces}")
        if not 0.01 <= self.threshold <= 1:
            raise InputError(f"the threshold {self.threshold} should lie in [0.01, 1]")
        if not 20 <= self.preprocess_resolution <= 100:
            raise InputError(
                f"the preprocess_resolution {self.preprocess_resolution} should lie in [20, 100]"
            )
        if not 60 <= self.search_iterations <= 2000:
            raise InputError(
                f"the search_iterations {self.search_iterations} should lie in [60, 2000]"
            )
        if not 0 < self.hull_tolerance_m < 0.1:
            raise InputError(
                f"the hull_tolerance_m {self.hull_tolerance_m} should lie between 0 and 0.1 m"
            )


def decompose(
    vertices: Float[ndarray, "v 3"], faces: Int[ndarray, "f 3"], how: Decomposition
) -> tuple[ConvexPiece, ...]:
    """Decompose a mesh into convex pieces with CoACD.

    A mesh of more than 200,000 faces is simplified first, which is logged as a warning. The same
    mesh, parameters and CoACD version give the same pieces. They are kept in the cache directory
    (:func:`graspcast.io.cache.cache_directory`) under a hash of all three; a damaged file there is
    computed again.

    Parameters
    ----------
    vertices, faces
        The mesh, metres.
    how
        The parameters.

    References
    ----------
    Wei et al., "Approximate Convex Decomposition for 3D Meshes with Collision-Aware Concavity and
    Tree Search", SIGGRAPH 2022.
    """
    path = cache_directory() / "convex" / f"{_digest(vertices, faces, how)}.npz"
    pieces = _read(path)
    if pieces is None:
        hulls = [vertices] if how.pieces == 1 else _run_coacd(*simplified(vertices, faces), how)
        pieces = tuple(convex_hull(points, how.hull_tolerance_m) for points in hulls)
        try:
            _write(path, pieces)
        except InputError as error:
            _log.warning("the convex pieces are not cached: %s", error)
    return pieces


def convex_hull(points: Float[ndarray, "n 3"], tolerance_m: float) -> ConvexPiece:
    """Compute a simplified convex hull of points, within a tolerance (metres).

    Starting from extreme points, the point farthest outside is added until none is outside by more
    than the tolerance. The vertices are points of the input, so the full hull contains it. Of more
    than 100,000 points, those that stick out in many directions stand for all.
    """
    from scipy.spatial import ConvexHull, QhullError

    points = extreme_points(points)
    try:
        corners = points[np.unique(ConvexHull(points).simplices)]
    except (QhullError, ValueError) as error:
        raise InputError(
            f"{len(points)} points span no volume, so they have no convex hull"
        ) from error
    chosen = _simplex(corners)
    farthest: dict[bytes, tuple[float, int]] = {}
    while True:
        hull = ConvexHull(corners[chosen])
        # A new vertex changes few planes; the corner farthest outside is known for the others.
        planes = {plane.tobytes(): plane for plane in hull.equations}
        new = {key: plane for key, plane in planes.items() if key not in farthest}
        farthest = {key: farthest[key] for key in planes if key in farthest}
        farthest |= _farthest(corners, new)
        distance, negative = max((d, -corner) for d, corner in farthest.values())
        if distance <= tolerance_m or -negative in chosen:
            break
        chosen.append(-negative)
    vertices = corners[chosen][hull.vertices]
    renumber = np.full(len(chosen), -1)
    renumber[hull.vertices] = np.arange(len(hull.vertices))
    return ConvexPiece(vertices, _outwards(vertices, renumber[hull.simplices]))


def _farthest(
    corners: Float[ndarray, "n 3"], planes: Mapping[bytes, Float[ndarray, " 4"]]
) -> dict[bytes, tuple[float, int]]:
    """Return by plane the largest distance of a corner outside of it, and the first such corner."""
    equations = np.array(list(planes.values())).reshape(-1, 4)
    found = {}
    size = max(1, _DISTANCES // len(corners))
    keys = list(planes)
    for first in range(0, len(keys), size):
        part = equations[first : first + size]
        distances = part[:, :3] @ corners.T + part[:, 3:]
        nearest = distances.argmax(axis=1)
        for key, row, corner in zip(keys[first : first + size], distances, nearest, strict=True):
            found[key] = (float(row[corner]), int(corner))
    return found


def _simplex(corners: Float[ndarray, "n 3"]) -> list[int]:
    """Return four points that span a large tetrahedron, each farthest from those before it."""
    first = int(corners[:, 0].argmin())
    offset = corners - corners[first]
    second = int(np.linalg.norm(offset, axis=1).argmax())
    from_line = np.cross(offset, offset[second] / np.linalg.norm(offset[second]))
    third = int(np.linalg.norm(from_line, axis=1).argmax())
    fourth = int(np.abs(offset @ np.cross(offset[second], offset[third])).argmax())
    return [first, second, third, fourth]


def _outwards(vertices: Float[ndarray, "v 3"], faces: Int[ndarray, "f 3"]) -> Int[ndarray, "f 3"]:
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    normal = np.cross(b - a, c - a)
    inwards = np.einsum("ij,ij->i", normal, a - vertices.mean(axis=0)) < 0
    return np.where(inwards[:, None], faces[:, ::-1], faces)


def _run_coacd(
    vertices: Float[ndarray, "v 3"], faces: Int[ndarray, "f 3"], how: Decomposition
) -> list[ndarray]:
    import coacd

    coacd.set_log_level("error")
    parts = coacd.run_coacd(
        coacd.Mesh(vertices, faces),
        threshold=how.threshold,
        max_convex_hull=how.pieces,
        preprocess_mode="on" if how.preprocess else "auto",
        preprocess_resolution=how.preprocess_resolution,
        resolution=_SAMPLES,
        mcts_nodes=_SEARCH_NODES,
        mcts_iterations=how.search_iterations,
        seed=how.seed,
    )
    if not parts:
        raise InputError(f"CoACD found no convex piece with {how}; try another threshold")
    return [np.asarray(points, dtype=np.float64) for points, _ in parts]


def _digest(vertices: Float[ndarray, "v 3"], faces: Int[ndarray, "f 3"], how: Decomposition) -> str:
    search = f"{version('coacd')} {_SAMPLES} {_SEARCH_NODES}"
    mesh = np.asarray(vertices, dtype="<f8"), np.asarray(faces, dtype="<i8")
    settings = asdict(how)
    if how.preprocess:
        del settings["preprocess"]  # as before there was the choice
    return sha256(search, canonical_json(settings), *mesh)[:32]


def _write(path: Path, pieces: tuple[ConvexPiece, ...]) -> None:
    arrays = {f"{kind}{i}": getattr(p, kind) for i, p in enumerate(pieces) for kind in _KINDS}
    write_arrays(path, arrays, compress=False)


_KINDS = ("vertices", "faces")


def _read(path: Path) -> tuple[ConvexPiece, ...] | None:
    if not path.exists():
        return None
    try:
        stored = read_arrays(path, "remove it")
        count = len(stored) // len(_KINDS)
        if count == 0:
            raise ValueError("no pieces")
        return tuple(ConvexPiece(*(stored[f"{k}{i}"] for k in _KINDS)) for i in range(count))
    except (FormatError, ValueError, KeyError) as error:
        _log.warning("%s is damaged (%s) and is computed again", path, error)
        return None
