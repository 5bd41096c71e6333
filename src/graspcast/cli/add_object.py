"""The verb ``add-object``: from a mesh to a BOP model and a catalogue entry."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_table, print_text
from graspcast.cli.options import Verbs, add_out, new_verb, positive
from graspcast.cli.progress import progress_bar
from graspcast.errors import GraspcastError, InputError

if TYPE_CHECKING:
    from graspcast.simulation.objects.adding import Source
    from graspcast.simulation.objects.mass_table import MassTable
    from graspcast.simulation.objects.new_object import NewObject, Told

__all__ = ["add"]

_UNITS = ("auto", "mm", "cm", "m", "inch")


def add(verbs: Verbs) -> None:
    """Add the verb ``add-object``."""
    verb = new_verb(
        verbs,
        "add-object",
        _add_object,
        "objects of one's own, from meshes",
        "Make a mesh (STL, OBJ, PLY, GLB) an object of a dataset: a BOP model in millimetres,\n"
        "models_info.json with its size and symmetries, and an entry of the catalogue\n"
        "objects.toml for simulate, grasps and watch (--catalogue). A folder of meshes, or the\n"
        "models of a BOP dataset, is added at once. The mesh keeps its origin and axes.",
    )
    verb.add_argument(
        "mesh", metavar="MESH", type=Path, help="a mesh, a folder of meshes, or BOP models"
    )
    verb.add_argument("--dataset", metavar="NAME", required=True, help="name of the dataset")
    verb.add_argument(
        "--id", metavar="N", type=int, help="number of the object, or of the first of a folder"
    )
    verb.add_argument(
        "--mass",
        metavar="KG",
        help="mass in kg; for a folder a CSV with the columns object, mass_kg and, if wanted,\n"
        "friction and label",
    )
    verb.add_argument(
        "--density", metavar="KG/M3", type=float, help="mean density, where no mass is given"
    )
    verb.add_argument(
        "--friction", metavar="MU", type=float, help="coefficient of friction (assumed: 0.8)"
    )
    verb.add_argument(
        "--unit", choices=_UNITS, default="auto", help="of the mesh (default: mm or m, by the size)"
    )
    verb.add_argument(
        "--up",
        metavar=("X", "Y", "Z"),
        type=float,
        nargs=3,
        help="direction that points up when the object stands (default: z, or as it lies)",
    )
    verb.add_argument(
        "--symmetry",
        metavar="NAME",
        nargs="+",
        default=["auto"],
        help="auto finds them; none, or z for any angle about z, x2 for half a turn about x",
    )
    verb.add_argument("--label", metavar="TEXT", help="name for people (default: the file's)")
    _add_choices(verb)
    add_out(verb, "directory of the dataset: models/ and objects.toml", directory=True)


def _add_choices(verb: argparse.ArgumentParser) -> None:
    """Add options that few objects need."""
    verb.add_argument(
        "--pieces", metavar="N", type=positive, help="largest number of collision pieces"
    )
    verb.add_argument(
        "--open-mesh",
        action="store_true",
        help="accept a mesh that is not closed: volume and inertia are of its collision pieces",
    )
    verb.add_argument(
        "--replace", action="store_true", help="replace another object of the same number"
    )
    verb.add_argument(
        "--lenient", action="store_true", help="leave out meshes that are refused, and say so"
    )


def _told(options: argparse.Namespace) -> tuple[Told, MassTable | None]:
    """Return what the options tell of every object, and the table of masses if one is given."""
    from graspcast.simulation.objects.mass_table import MassTable
    from graspcast.simulation.objects.new_object import Told
    from graspcast.simulation.objects.symmetry_names import check_symmetry_names

    check_symmetry_names(options.symmetry)
    told = Told(
        density=options.density,
        label=options.label,
        up=None if options.up is None else tuple(options.up),
        symmetry=tuple(options.symmetry),
        unit=options.unit,
        pieces=options.pieces,
        open_mesh=options.open_mesh,
    )
    from dataclasses import replace

    if options.friction is not None:
        told = replace(told, friction=options.friction, friction_source="given")
    if options.mass is None:
        return told, None
    try:
        return replace(told, mass_kg=float(options.mass)), None
    except ValueError:
        return told, MassTable(Path(options.mass))


def _check(options: argparse.Namespace, sources: Sequence[Source], told: Told) -> list[Source]:
    """Refuse what fits neither several objects nor a built-in dataset; return what is added."""
    from graspcast.simulation.objects.adding import built_in_ids

    if len(sources) > 1:
        for name in ("label", "up"):
            if getattr(options, name) is not None:
                raise InputError(
                    f"{options.mesh}: has {len(sources)} objects, which cannot share one {name}; "
                    "add them one by one",
                    parameters=(name,),
                )
        if told.mass_kg is not None:
            raise InputError(
                f"{options.mesh}: has {len(sources)} objects, but one mass is given; give a table, "
                "or a density",
                parameters=("mass", "density"),
            )
    built_in = built_in_ids(options.dataset)
    if built_in and sources[0].info is None:
        raise InputError(
            f"{options.dataset} is a published dataset with objects that are built in, and its "
            "estimates are in the frames of its own models: give those (the folder with "
            "models_info.json), or choose another name",
            parameters=("dataset",),
        )
    if taken := [s.obj_id for s in sources if s.obj_id in built_in]:
        names = ", ".join(f"{options.dataset}-{i}" for i in taken)
        note(f"left out what is built in: {names}")
    kept = [s for s in sources if s.obj_id not in built_in]
    if not kept:
        raise InputError(
            f"{options.mesh}: every object of it is built in already", parameters=("dataset",)
        )
    return kept


def _make(
    options: argparse.Namespace, sources: Sequence[Source], told: Told, table: MassTable | None
) -> list[NewObject]:
    from graspcast.simulation.objects.new_object import check_mesh, make_object

    made: list[NewObject] = []
    refused: dict[Path, str] = {}
    # What a file alone tells is said before hours of decomposition.
    steps = (check_mesh, make_object) if len(sources) > 1 else (make_object,)
    for step in steps:
        with progress_bar("checking" if step is check_mesh else "adding") as move:
            for i, source in enumerate([s for s in sources if s.path not in refused]):
                move(i / len(sources), source.path.name)
                try:
                    mine = told if table is None else table.told(source.path, source.obj_id, told)
                    one = step(source.path, options.dataset, source.obj_id, mine, info=source.info)
                    if one is not None:
                        made.append(one)
                except GraspcastError as error:
                    if len(sources) == 1:
                        raise
                    refused[source.path] = str(error)
        _check_refused(options, sources, list(refused.values()))
    if refused:
        note(*(f"left out: {text}" for text in refused.values()))
    if table is not None and table.unused:
        note(f"{table.path}: no mesh has the names {', '.join(table.unused)}")
    return made


def _check_refused(
    options: argparse.Namespace, sources: Sequence[Source], refused: Sequence[str]
) -> None:
    """Raise if objects are refused, unless they are to be left out and others are left."""
    if refused and not (options.lenient and len(refused) < len(sources)):
        note(*refused)
        raise InputError(
            f"{options.mesh}: {len(refused)} of {len(sources)} objects are refused, and nothing is "
            "written",
            parameters=("lenient",),
        )


def _add_object(options: argparse.Namespace) -> None:
    from graspcast.simulation.objects.adding import CATALOGUE, find_sources, write_objects

    if not options.dataset.strip() or any(c in options.dataset for c in "/\\-.= "):
        raise InputError(
            f"the dataset's name {options.dataset!r} should have no spaces, dashes, dots, slashes "
            "or equals signs",
            parameters=("dataset",),
        )
    if options.out.exists() and not options.out.is_dir():
        raise InputError(f"{options.out}: is a file, not a directory", parameters=("out",))
    told, table = _told(options)
    sources = _check(options, find_sources(options.mesh, options.id), told)
    made = _make(options, sources, told, table)
    bop_models = sources[0].info is not None
    done = write_objects(made, options.out, bop_models=bop_models, replace=options.replace)
    note(*(remark for one in made for remark in one.remarks), *_remarks(options, made))
    header = ["object", "", "size", "unit", "mass", "up", "symmetry (of the shape)", "collision"]
    rows = [_row(one, how) for one, how in zip(made, done, strict=True)]
    print_table("Objects", header, rows)
    root = options.mesh if bop_models else options.out
    root = root.parent if bop_models and root.name.startswith("models") else root
    print_text(f"{options.out / CATALOGUE}: use --catalogue {options.out / CATALOGUE}")
    print_text(f"--bop {options.dataset}={root} for estimates of these objects")


def _row(one: NewObject, done: str) -> tuple[str, ...]:
    from graspcast.simulation.objects.plausibility import by_sides, density_of

    entry = one.entry
    up = " ".join(f"{x:.3g}" for x in entry.up)
    density = density_of(one.grasp_object) if entry.inertia == "mesh" else ""
    return (
        f"{entry.name} ({entry.label})",
        done,
        by_sides(one.mesh.vertices),
        one.unit,
        f"{entry.mass_kg:.3g} kg" + (f", {density}" if density else ""),
        {"0 0 1": "z", "0 1 0": "y", "1 0 0": "x"}.get(up, up),
        str(one.symmetries),
        str(one.collision),
    )


def _remarks(options: argparse.Namespace, made: Sequence[NewObject]) -> list[str]:
    """Return what holds for all objects."""
    said = ["origin and axes are those of the mesh files, in models, estimates and grasps alike"]
    if any(one.entry.friction_source.startswith("assumed") for one in made):
        said.append("friction 0.8 is assumed (--friction): coated cardboard or plastic on rubber")
    if options.up is None and any(one.entry.up != (0.0, 0.0, 1.0) for one in made):
        said.append("if an object stands otherwise, say how: --up 0 1 0 for y up")
    if any(one.collision.sticks_out_m > _STICKS_OUT_M for one in made):
        said.append(
            "where collision pieces reach far outside of the mesh, they fill hollows; --pieces 16 "
            "or more fits closer, and each trial takes longer"
        )
    if options.symmetry == ["auto"] and any(str(one.symmetries) != "none" for one in made):
        said.append(
            "symmetries are of the shape alone: if a print or a colour tells the sides apart, say "
            "--symmetry none"
        )
    return said


_STICKS_OUT_M = 0.003
