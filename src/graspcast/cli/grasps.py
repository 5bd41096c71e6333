"""TODO."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from graspcast.cli.console import print_table, print_text, progress_bar
from graspcast.errors import InputError

if TYPE_CHECKING:
    pass

__all__ = []


def _grasps(options: argparse.Namespace) -> None:
    from graspcast.rendering.opengl_context import import_mujoco

    import_mujoco()
    from graspcast.rendering.trials.contact_sheet import draw_cells, save_sheet
    from graspcast.simulation.grasps.table import read_grasps
    from graspcast.simulation.grippers import GRIPPERS, load_gripper
    from graspcast.simulation.objects.catalogue import read_catalogue

    if options.out.suffix.lower() != ".png":
        raise InputError(f"{options.out}: a contact sheet is drawn to .png")
    catalogue = read_catalogue(options.catalogue)
    entries = [catalogue[name] for name in options.objects or catalogue]
    grippers = [load_gripper(name) for name in options.gripper or GRIPPERS]
    _tell_drawer()
    with progress_bar("drawing") as move:
        cells = draw_cells(
            entries,
            grippers,
            read_grasps(options.grasps),
            catalogue=catalogue,
            bop_dirs=_bop_dirs(options),
            size=options.size,
            collision=options.collision,
            progress=move,
        )
    labels = [(entry.name, entry.label) for entry in entries]
    save_sheet(options.out, labels, [g.name for g in grippers], cells, size=options.size)
    rows = [(f"{name} by {gripper}", cell.note) for (name, gripper), cell in cells.items()]
    print_table("reference grasps, perfect estimate", ["", "outcome"], rows)
    print_text(str(options.out))
