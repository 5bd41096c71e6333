"""The verb ``grasps``: a contact sheet of the reference grasps."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_table, print_text
from graspcast.cli.options import (
    Verbs,
    add_bop,
    add_out,
    add_tables,
    bop_dirs_of,
    field_size,
    new_verb,
    note_sizes,
    note_software_drawing,
)
from graspcast.cli.progress import progress_bar
from graspcast.cli.protocol_options import add_protocol, settings_of
from graspcast.errors import InputError

if TYPE_CHECKING:
    from graspcast.rendering.trials.contact_sheet import Cell
    from graspcast.simulation.objects.catalogue import ObjectEntry

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``grasps``."""
    verb = new_verb(
        verbs,
        "grasps",
        _grasps,
        "a contact sheet of the reference grasps",
        "Run each reference grasp with a perfect estimate and draw the closed hand, with the\n"
        "outcome below (the paper's Figure 2).",
    )
    add_bop(verb)
    verb.add_argument("--objects", metavar="NAME", nargs="+", default=[], help="only these")
    verb.add_argument(
        "--gripper",
        metavar="NAME",
        action="append",
        default=[],
        help="name, or the .toml file of a custom one; only these; may be repeated",
    )
    verb.add_argument(
        "--every-grasp",
        action="store_true",
        help="draw every grasp of an object, not the reference grasp alone",
    )
    add_tables(verb)
    add_protocol(verb)
    verb.add_argument(
        "--size", metavar="PIXELS", type=field_size, default=320, help="of a picture (default: 320)"
    )
    add_out(verb, "the sheet (.png)")


def _labels(
    entries: Sequence[ObjectEntry], cells: Mapping[tuple[str, str], Cell]
) -> list[tuple[str, str]]:
    """Return the columns of the sheet: an object, or one of its grasps, with its label."""
    found = []
    for name in dict.fromkeys(name for name, _ in cells):
        entry = next(e for e in entries if name == e.name or name.startswith(f"{e.name}, "))
        found.append((name, entry.label))
    return found


def _grasps(options: argparse.Namespace) -> None:
    from graspcast.rendering.trials.contact_sheet import draw_cells, save_sheet
    from graspcast.simulation.grasps.table import read_grasps
    from graspcast.simulation.grippers import GRIPPERS, load_grippers
    from graspcast.simulation.objects.catalogue import read_catalogue

    if options.out.suffix.lower() != ".png":
        raise InputError(f"{options.out}: a contact sheet is a .png file", parameters=("out",))
    catalogue = read_catalogue(options.catalogue)
    entries = [catalogue[name] for name in options.objects or catalogue]
    grippers = list(load_grippers(options.gripper or GRIPPERS).values())
    settings = {gripper.name: settings_of(options, gripper) for gripper in grippers}
    note_software_drawing()
    with progress_bar("drawing") as move:
        cells = draw_cells(
            entries,
            grippers,
            read_grasps(options.grasps, protocol=options.protocol),
            settings=settings,
            catalogue=catalogue,
            bop_dirs=bop_dirs_of(options),
            size=options.size,
            collision=options.collision,
            every_grasp=options.every_grasp,
            progress=move,
        )
    note_sizes([cell.target for cell in cells.values() if cell.target is not None], grippers)
    labels = _labels(entries, cells)
    save_sheet(options.out, labels, [g.name for g in grippers], cells, size=options.size)
    rows = [(f"{name} by {gripper}", cell.note) for (name, gripper), cell in cells.items()]
    which = "Grasps" if options.every_grasp else "Reference grasps"
    print_table(f"{which} with a perfect estimate", ["", "outcome"], rows)
    collided = [
        f"{name} by {gripper}"
        for (name, gripper), cell in cells.items()
        if cell.outcome is not None and cell.outcome.reason == "collided"
    ]
    if collided:
        note(
            f"collides even with a perfect estimate: {', '.join(collided)}; choose a grasp that "
            "leaves the hand more room"
        )
    print_text(str(options.out))
