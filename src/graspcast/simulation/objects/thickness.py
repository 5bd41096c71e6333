"""Thickness that collision pieces add to an object: measured once, kept, and said if it is much."""

from __future__ import annotations

import logging

import numpy as np

from graspcast.errors import GraspcastError
from graspcast.io.artefacts import read_artefact, write_artefact
from graspcast.io.cache import cache_directory
from graspcast.io.hashing import sha256
from graspcast.pose.lengths import shown
from graspcast.simulation.objects.collision import sticks_out
from graspcast.simulation.objects.surface import Surface
from graspcast.simulation.objects.types import ConvexPiece, GraspObject

__all__ = ["NOTED_SHARE", "added_thickness", "warn_of_thickness"]

_log = logging.getLogger(__name__)

NOTED_SHARE = 0.15
"""Added thickness that is said, as a share of the smallest side of the object's bounding box."""


def added_thickness(target: GraspObject) -> float:
    """Return how far an object's convex pieces stick out of its mesh, metres; 0 for primitives.

    It is kept in the cache directory, under a digest of mesh and pieces.
    """
    pieces = [piece for piece in target.pieces if isinstance(piece, ConvexPiece)]
    if len(pieces) < len(target.pieces):
        return 0.0
    arrays = [target.vertices, target.faces]
    arrays += [array for piece in pieces for array in (piece.vertices, piece.faces)]
    path = cache_directory() / "thickness" / f"{sha256(*arrays)[:32]}.json"
    if path.exists():
        try:
            return float(read_artefact(path, "remove it")["sticks_out_m"])
        except (GraspcastError, KeyError, TypeError, ValueError) as error:
            _log.warning("%s is damaged (%s) and is computed again", path, error)
    found = sticks_out(pieces, Surface(target.vertices, target.faces))
    try:
        write_artefact(path, {"sticks_out_m": found})
    except GraspcastError as error:
        _log.warning("the thickness of collision pieces is not cached: %s", error)
    return found


def warn_of_thickness(target: GraspObject) -> None:
    """Log a warning if collision pieces stick out of an object's mesh by more than a share of it.

    The share is :data:`NOTED_SHARE` of the smallest side of the bounding box.
    """
    smallest = float(np.ptp(target.vertices, axis=0).min())
    out = added_thickness(target)
    if out <= NOTED_SHARE * smallest:
        return
    count = len(target.pieces)
    _log.warning(
        "object %s: its %s up to %s outside of its mesh, whose smallest side is %s: they fill a "
        "hollow, or make a wall thicker, and fingers touch them there. In the catalogue, "
        "collision = { pieces = %d } fits closer, and preprocess = false keeps thin walls of a "
        "closed mesh thin",
        target.name,
        "collision piece reaches" if count == 1 else f"{count} collision pieces reach",
        shown(out),
        shown(smallest),
        max(8, 2 * count),
    )
