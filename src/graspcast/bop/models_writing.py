"""Writing of BOP object models: ``models_info.json`` beside the meshes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import ContinuousSymmetry
from graspcast.bop.units import millimetres
from graspcast.io.json import by_identifier, read_json, write_json

__all__ = ["diameter", "extreme_points", "info_entry", "update_models_info"]


_MOST_POINTS = 100_000
_DIRECTIONS = 4000


def extreme_points(
    points: Float[ndarray, "n 3"], most: int = _MOST_POINTS
) -> Float[ndarray, "m 3"]:
    """Return the points that stick out farthest in 4,000 directions, or all if they are few.

    Their convex hull is smaller than that of all points by at most 0.05 % of the diameter, and a
    scan of a round object, most of whose points are corners of its hull, becomes quick to handle.
    """
    if len(points) <= most:
        return points
    # Evenly spread over the sphere (Fibonacci).
    z = 1 - (2 * np.arange(_DIRECTIONS) + 1) / _DIRECTIONS
    angle, flat = np.arange(_DIRECTIONS) * np.pi * (3 - np.sqrt(5)), np.sqrt(1 - z**2)
    towards = np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=-1)
    columns = np.ascontiguousarray((points - points.mean(axis=0)).T, dtype=np.float32)
    parts = np.array_split(towards.astype(np.float32), 200)
    farthest = [np.argmax(part @ columns, axis=1) for part in parts]
    return points[np.unique(np.concatenate(farthest))]


def diameter(vertices: Float[ndarray, "v 3"]) -> float:
    """Return the largest distance of two vertices, in their unit.

    It is exact to 0.1 %, and exact if the convex hull has at most 4,000 corners.
    """
    from scipy.spatial import ConvexHull
    from scipy.spatial.distance import pdist

    points = extreme_points(vertices)
    corners = extreme_points(points[ConvexHull(points).vertices], _DIRECTIONS)
    return float(pdist(corners).max())


def info_entry(
    vertices: Float[ndarray, "v 3"],
    discrete: Float[ndarray, "s 4 4"] | None = None,
    continuous: Sequence[ContinuousSymmetry] = (),
) -> dict[str, Any]:
    """Return an object's entry of ``models_info.json``, in millimetres.

    Parameters
    ----------
    vertices
        The mesh, metres; diameter and bounds are its own.
    discrete
        Symmetries without the identity, metres.
    continuous
        Axes about which any angle is a symmetry.
    """
    low, size = millimetres(vertices.min(axis=0)), millimetres(np.ptp(vertices, axis=0))
    entry: dict[str, Any] = {"diameter": float(millimetres(np.array(diameter(vertices))))}
    entry |= {f"min_{a}": float(x) for a, x in zip("xyz", low, strict=True)}
    entry |= {f"size_{a}": float(x) for a, x in zip("xyz", size, strict=True)}
    if discrete is not None and len(discrete):
        poses = np.array(discrete)
        poses[:, :3, 3] = millimetres(poses[:, :3, 3])
        entry["symmetries_discrete"] = (poses.reshape(-1, 16) + 0.0).tolist()
    if continuous:
        entry["symmetries_continuous"] = [
            {"axis": (s.axis + 0.0).tolist(), "offset": (millimetres(s.offset) + 0.0).tolist()}
            for s in continuous
        ]
    return entry


def update_models_info(path: str | PathLike[str], entries: Mapping[int, Mapping[str, Any]]) -> None:
    """Write objects into a ``models_info.json``, atomically; others that it lists stay as they are.

    Raises
    ------
    FormatError
        If the file is there and is no dictionary of objects.
    """
    known: dict[int, Any] = {}
    if Path(path).exists():
        known = {i: entry for i, _, entry in by_identifier(read_json(path, dict), path, "object")}
    merged = {**known, **entries}
    write_json(path, {str(i): merged[i] for i in sorted(merged)})
