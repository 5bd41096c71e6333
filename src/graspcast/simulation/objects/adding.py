"""Adding objects to a dataset: models, ``models_info.json`` and a catalogue, all or nothing.

What is there already is compared first, and nothing is written if anything is wrong. Each file is
written atomically, the catalogue last, so that an interrupted call can be repeated. A lock keeps
two processes from writing to one directory at once.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from graspcast.bop.meshes import Mesh, write_mesh
from graspcast.bop.models import ModelInfo, read_models_info
from graspcast.bop.models_writing import info_entry, update_models_info
from graspcast.errors import FormatError, InputError, MismatchError
from graspcast.io.locks import exclusive_lock
from graspcast.simulation.objects.catalogue import read_catalogue
from graspcast.simulation.objects.catalogue_file import (
    entry_table,
    known_tables,
    update_catalogue,
)
from graspcast.simulation.objects.colours import read_colours
from graspcast.simulation.objects.frames import frame_difference
from graspcast.simulation.objects.meshes import MESH_SUFFIXES, read_mesh
from graspcast.simulation.objects.new_object import NewObject

__all__ = ["CATALOGUE", "Source", "built_in_ids", "find_sources", "write_objects"]

CATALOGUE = "objects.toml"
"""Name of the catalogue in the directory of the dataset."""

_PRECISION_M = 1e-6
_WAIT_S = 60.0
_MODEL = re.compile(r"obj_([0-9]+)")


@dataclass(frozen=True)
class Source:
    """A mesh to add.

    Attributes
    ----------
    path
        The file.
    obj_id
        Its number in the dataset.
    info
        Its entry of ``models_info.json``, if it is a model of a BOP dataset.
    """

    path: Path
    obj_id: int
    info: ModelInfo | None = None


def built_in_ids(dataset: str) -> list[int]:
    """Return the numbers of a dataset's objects in the built-in catalogue."""
    entries = read_catalogue().values()
    return sorted(int(e.obj_id or 0) for e in entries if e.dataset == dataset)


def find_sources(path: Path, obj_id: int | None) -> list[Source]:
    """Find the meshes that a path names: a file, a folder of meshes, or BOP models.

    A folder with ``models_info.json``, or with ``models/models_info.json``, holds BOP models: their
    numbers, units and symmetries stand. In another folder, meshes called ``obj_000003.stl`` have
    that number, if all have one; otherwise they are numbered in the order of their names.

    Parameters
    ----------
    path
        The file or folder.
    obj_id
        Number of the object, or of the first of a folder without numbers; from 1 if None.

    Raises
    ------
    InputError
        If there is nothing to add, or the number is missing, negative or not needed.
    """
    if obj_id is not None and not 0 <= obj_id < 1_000_000:
        raise InputError(f"the number {obj_id} should be 0 to 999999", parameters=("id",))
    if not path.is_dir():
        if not path.exists():
            raise InputError(f"{path}: there is no such mesh or folder")
        if obj_id is None:
            raise InputError(
                f"{path}: the object needs a number, that of its estimates", parameters=("id",)
            )
        return [Source(path, obj_id)]
    for folder in (path, path / "models"):
        if (folder / "models_info.json").is_file():
            return _bop_models(folder, obj_id)
    meshes = sorted(p for p in path.iterdir() if p.suffix.lower() in MESH_SUFFIXES)
    if not meshes:
        raise InputError(
            f"{path}: has no mesh ({', '.join(MESH_SUFFIXES)}) and no models_info.json"
        )
    numbers = [_MODEL.fullmatch(p.stem) for p in meshes]
    if all(numbers) and obj_id is None:
        found = [Source(p, int(n[1])) for p, n in zip(meshes, numbers, strict=True) if n]
    else:
        found = [Source(p, i) for i, p in enumerate(meshes, 1 if obj_id is None else obj_id)]
    if len({s.obj_id for s in found}) < len(found):
        raise InputError(f"{path}: two meshes have the same number; keep one of each")
    return found


def _bop_models(folder: Path, obj_id: int | None) -> list[Source]:
    infos = read_models_info(folder / "models_info.json")
    if obj_id is not None and obj_id not in infos:
        raise InputError(
            f"{folder / 'models_info.json'}: has no object {obj_id}", parameters=("id",)
        )
    wanted = sorted(infos) if obj_id is None else [obj_id]
    sources = [Source(folder / f"obj_{i:06d}.ply", i, infos[i]) for i in wanted]
    if missing := [s.path.name for s in sources if not s.path.is_file()]:
        raise InputError(
            f"{folder}: models_info.json lists {len(infos)} objects, but there is no "
            f"{', '.join(missing[:5])}{' …' if len(missing) > 5 else ''}"
        )
    return sources


def write_objects(
    new: Sequence[NewObject], out: Path, *, bop_models: bool, replace: bool = False
) -> list[str]:
    """Write objects into a dataset's directory; of two processes, one waits for the other.

    Parameters
    ----------
    new
        The objects.
    out
        The directory of the dataset: ``models/`` and ``objects.toml`` are in it.
    bop_models
        Whether the meshes are models of a BOP dataset, which stay where they are.
    replace
        Whether other objects of the same numbers are replaced.

    Returns
    -------
        For each object ``"added"``, ``"replaced"`` or ``"unchanged"``.

    Raises
    ------
    MismatchError
        If another object has the number, and is not to be replaced; the message says how the
        meshes differ.
    InputError
        If another process has been writing there for more than a minute, or a file cannot be
        written.
    """
    busy = f"{out}: another process is adding objects here; try again when it is done"
    with exclusive_lock(out / ".lock", busy, wait_s=_WAIT_S):
        return _write_objects(new, out, bop_models=bop_models, replace=replace)


def _write_objects(
    new: Sequence[NewObject], out: Path, *, bop_models: bool, replace: bool
) -> list[str]:
    catalogue, models = out / CATALOGUE, out / "models"
    known, listed = known_tables(catalogue), models / "models_info.json"
    infos = read_models_info(listed) if listed.is_file() and not bop_models else {}
    tables: dict[str, dict[str, Any]] = {}
    entries: dict[int, dict[str, Any]] = {}
    meshes: list[NewObject] = []
    done = []
    for one in new:
        obj_id = int(one.entry.obj_id or 0)
        table = entry_table(one.entry, _mesh_name(one, models, out, bop_models=bop_models))
        before = known.get(one.entry.name)
        changed = before is not None and before != table
        if not bop_models:
            model = models / f"obj_{obj_id:06d}.ply"
            fresh = _is_fresh(one, model, replace=replace)
            entry = info_entry(
                one.mesh.vertices, one.symmetries.discrete, one.symmetries.continuous
            )
            stands = obj_id in infos and not fresh and _same_info(infos[obj_id], one)
            changed |= obj_id in infos and not stands
            if fresh:
                meshes.append(one)
            if fresh or not stands:
                entries[obj_id] = entry
        if changed and not replace:
            raise MismatchError(
                f"{out}: {one.entry.name} is there already, with {_other(before, table)}; choose "
                "another number, or replace it",
                parameters=("id", "replace"),
            )
        tables[one.entry.name] = table
        added = before is None or (obj_id in entries and obj_id not in infos)
        done.append("added" if added else "replaced" if changed else "unchanged")
    for one in meshes:
        write_mesh(models / f"obj_{int(one.entry.obj_id or 0):06d}.ply", one.mesh, one.colours)
    if entries:
        update_models_info(listed, entries)
    if any(known.get(name) != table for name, table in tables.items()):
        update_catalogue(catalogue, tables)
    return done


def _mesh_name(one: NewObject, models: Path, out: Path, *, bop_models: bool) -> str | None:
    """Return what the catalogue calls the mesh; None if it is elsewhere, in its BOP dataset."""
    name = f"models/obj_{int(one.entry.obj_id or 0):06d}.ply"
    inside = not bop_models or (
        one.entry.mesh is not None and one.entry.mesh.resolve() == (out / name).resolve()
    )
    return name if inside else None


def _is_fresh(one: NewObject, model: Path, *, replace: bool) -> bool:
    """Return whether the model has to be written: it is not there, or is to be replaced.

    Raises
    ------
    MismatchError
        If it is there with another shape or frame, and is not to be replaced.
    """
    if not model.is_file():
        return True
    try:
        there = read_mesh(model, "mm")
        difference = frame_difference(one.mesh, there)
    except FormatError:
        if replace:
            return True
        raise
    if not difference and _identical(one.mesh, there):
        if _same_colours(one, model):
            return False
        difference = "the same mesh in other colours"
    difference = difference or (
        f"a mesh that is a little different ({len(one.mesh.vertices):,} vertices, not "
        f"{len(there.vertices):,})"
    )
    if not replace:
        raise MismatchError(
            f"{model} is there already, and {one.entry.mesh} differs from it: it holds "
            f"{difference}. Estimates are in the frame of the model that they were made with; use "
            "that model, choose another number, or replace it",
            parameters=("id", "replace"),
        )
    return True


def _identical(mine: Mesh, other: Mesh) -> bool:
    """Return whether two meshes have the same vertices, to the precision of a written model."""
    from scipy.spatial import cKDTree

    if len(mine.vertices) != len(other.vertices) or len(mine.faces) != len(other.faces):
        return False
    return bool(cKDTree(mine.vertices).query(other.vertices)[0].max() < _PRECISION_M)


def _same_colours(one: NewObject, model: Path) -> bool:
    """Return whether a written model has the colours of an object, or that has none."""
    if one.colours is None:
        return True
    found = read_colours(model, one.mesh, "mm")
    return found is not None and np.array_equal(one.colours, found)


def _same_info(info: ModelInfo, one: NewObject) -> bool:
    return len(info.discrete) == len(one.symmetries.discrete) and len(info.continuous) == len(
        one.symmetries.continuous
    )


def _other(before: Mapping[str, Any] | None, after: Mapping[str, Any]) -> str:
    """Say what differs between two entries."""
    if before is None:
        return "other symmetries"
    keys = [key for key in {**before, **after} if before.get(key) != after.get(key)]
    if not keys:
        return "other symmetries"
    return ", ".join(f"{key} = {before.get(key)!r} (now {after.get(key)!r})" for key in keys)
