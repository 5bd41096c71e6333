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

__all__ = ["diameter", "info_entry", "update_models_info"]


_MOST_CORNERS = 4000


def diameter(vertices: Float[ndarray, "v 3"]) -> float:
    """Return the largest distance of two vertices, in their unit.

    Where the convex hull has more than 4,000 corners, as that of a scanned ball, those that stick
    out farthest in as many directions are compared, and the result may be 0.1 % too small.
    """
    from scipy.spatial import ConvexHull
    from scipy.spatial.distance import pdist

    corners = vertices[ConvexHull(vertices).vertices]
    if len(corners) > _MOST_CORNERS:
        towards = np.random.default_rng(0).normal(size=(_MOST_CORNERS, 3))
        farthest = [np.argmax(corners @ part.T, axis=0) for part in np.array_split(towards, 40)]
        corners = corners[np.unique(np.concatenate(farthest))]
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
