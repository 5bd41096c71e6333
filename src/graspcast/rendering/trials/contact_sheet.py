"""Contact sheet of reference grasps: the closed hand on each object (the paper's Figure 2)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from graspcast.errors import ExtraMissingError, InputError, MismatchError
from graspcast.rendering.drawing import FAINT, INK, blank, save_png, write
from graspcast.rendering.trials.film import describe, write_outcome
from graspcast.rendering.trials.renderer import SceneRenderer
from graspcast.simulation.grasps.table import GraspTable, ReferenceGrasp
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.objects.catalogue import Catalogue, ObjectEntry
from graspcast.simulation.objects.load import BopDirectories, load_object, why_no_mesh
from graspcast.simulation.objects.types import Grasp, GraspObject
from graspcast.simulation.trial.recording import record_trial
from graspcast.simulation.trial.trial import Outcome, TrialRunner, TrialSettings

__all__ = ["Cell", "draw_cells", "draw_grasps", "save_sheet"]


@dataclass(frozen=True, eq=False)
class Cell:
    """One cell of a contact sheet.

    Attributes
    ----------
    pixels
        The picture, or None for an empty cell.
    note
        Text below it; in an empty cell, the reason.
    outcome
        Outcome of the trial, if any.
    target
        The object, with the mass and friction of the grasp, if there was a trial.
    """

    pixels: UInt8[ndarray, "h w 3"] | None
    note: str
    outcome: Outcome | None = None
    target: GraspObject | None = None


def draw_cells(
    entries: Sequence[ObjectEntry],
    grippers: Sequence[Gripper],
    grasps: GraspTable,
    *,
    settings: Mapping[str, TrialSettings] | None = None,
    catalogue: Catalogue,
    bop_dirs: BopDirectories | None = None,
    size: int = 320,
    collision: bool = False,
    every_grasp: bool = False,
    progress: Callable[[float, str], None] | None = None,
) -> dict[tuple[str, str], Cell]:
    """Run each reference grasp with a perfect estimate, and draw the closed hand.

    The cell is empty if there is no grasp, or no mesh of the object.

    Parameters
    ----------
    entries
        Objects.
    grippers
        Grippers.
    grasps
        Reference grasps.
    settings
        How the trials are run, by gripper's name; the robot's protocol if None.
    catalogue
        The catalogue of the objects.
    bop_dirs
        BOP directory by dataset.
    size
        Size of a picture, pixels.
    collision
        Draw the collision pieces instead of the mesh.
    every_grasp
        Draw all grasps of an object, not the reference grasp alone.
    progress
        Called with the share done and a short message.

    Returns
    -------
        Cells by name of object (of several grasps, of object and grasp) and gripper.
    """
    cells: dict[tuple[str, str], Cell] = {}
    total, done = len(entries) * len(grippers), 0
    for entry in entries:
        try:
            target = load_object(entry.name, bop_dirs=bop_dirs, catalogue=catalogue)
            missing = None
        except (InputError, ExtraMissingError) as error:
            absent = entry.mesh is None and why_no_mesh(entry, bop_dirs)
            missing = Cell(None, "no mesh" if absent else str(error))
        for gripper in grippers:
            pair = (entry.name, gripper.name)
            if pair not in grasps:
                cells[pair] = Cell(None, "no reference grasp")
            elif missing is not None:
                cells[pair] = missing
            else:
                chosen = grasps.of(*pair) if every_grasp else (grasps(*pair),)
                how = None if settings is None else settings[gripper.name]
                try:
                    drawn = draw_grasps(
                        target, gripper, chosen, settings=how, size=size, collision=collision
                    )
                except MismatchError as error:
                    drawn = {(chosen[0].grasp.name, gripper.name): Cell(None, str(error))}
                for (name, _), cell in drawn.items():
                    column = entry.name if len(chosen) == 1 else f"{entry.name}, {name}"
                    cells[column, gripper.name] = cell
            done += 1
            if progress is not None:
                progress(done / total, f"{entry.name} by {gripper.name}")
    return cells


def draw_grasps(
    target: GraspObject,
    gripper: Gripper,
    references: Sequence[ReferenceGrasp],
    *,
    settings: TrialSettings | None = None,
    size: int = 320,
    collision: bool = False,
    progress: Callable[[float, str], None] | None = None,
) -> dict[tuple[str, str], Cell]:
    """Run several grasps of one object with a perfect estimate, and draw the closed hand.

    Parameters
    ----------
    target, gripper, references
        The object, the gripper, and grasps of the one by the other.
    settings
        How the trials are run; the robot's protocol if None.
    size, collision, progress
        As for :func:`draw_cells`.

    Returns
    -------
        Cells by name of grasp and gripper.
    """
    cells: dict[tuple[str, str], Cell] = {}
    for reference in references:
        runner = TrialRunner(reference.applied_to(target), gripper, settings)
        name = reference.grasp.name
        cells[name, gripper.name] = _draw_cell(runner, reference.grasp, size, collision)
        if progress is not None:
            progress(len(cells) / len(references), name)
    return cells


def _draw_cell(runner: TrialRunner, grasp: Grasp, size: int, collision: bool) -> Cell:
    target, gripper = runner.grasp_object, runner.gripper
    recording = record_trial(runner, np.eye(4), grasp)
    state = (recording.of("close") or recording.states)[-1]
    with SceneRenderer(target, gripper, width=size, height=size, collision=collision) as renderer:
        pixels = renderer.image(state, renderer.close_up(state))
    return Cell(pixels, describe(recording.outcome), recording.outcome, target)


def save_sheet(
    path: str | PathLike[str],
    objects: Sequence[tuple[str, str]],
    grippers: Sequence[str],
    cells: Mapping[tuple[str, str], Cell],
    *,
    size: int,
    columns: int = 5,
) -> None:
    """Write a contact sheet as PNG, with a cell for each object and gripper.

    Parameters
    ----------
    path
        Path of the PNG file.
    objects
        Name and label of each object, in order.
    grippers
        Names of the grippers; the cells of one object are below one another.
    cells
        Cells by name of object and gripper.
    size
        Size of a picture, pixels.
    columns
        Number of objects in a row.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    from PIL import Image

    columns = min(columns, len(objects))
    bands = -(-len(objects) // columns)
    head, foot, gap, side = 34, 26, 22, 40
    band = head + len(grippers) * (size + foot) + gap
    sheet, draw = blank(side + columns * (size + 8), bands * band)
    for k, (name, label) in enumerate(objects):
        x, y = side + (k % columns) * (size + 8), (k // columns) * band
        write(draw, (x + size // 2, y + head // 2), f"{label}  ({name})", 18, INK, "mm")
        for row, gripper in enumerate(grippers):
            top = y + head + row * (size + foot)
            cell = cells.get((name, gripper), Cell(None, "no such grasp"))
            if k % columns == 0:
                _sideways(sheet, (side // 2, top + size // 2), gripper)
            if cell.pixels is None:
                draw.rectangle((x, top, x + size - 1, top + size - 1), outline=(225, 226, 228))
                write(draw, (x + size // 2, top + size // 2), cell.note, 15, FAINT, "mm")
                continue
            sheet.paste(Image.fromarray(cell.pixels), (x, top))
            at = (x + size // 2, top + size + foot // 2 - 2)
            if cell.outcome is not None:
                write_outcome(draw, at, cell.outcome, 15, "mm")
            else:
                write(draw, at, cell.note, 15, FAINT, "mm")
    save_png(path, sheet)


def _sideways(sheet: Any, middle: tuple[int, int], text: str) -> None:
    label, draw = blank(240, 28)
    write(draw, (120, 14), text, 18, INK, "mm")
    turned = label.rotate(90, expand=True)
    sheet.paste(turned, (middle[0] - turned.width // 2, middle[1] - turned.height // 2))
