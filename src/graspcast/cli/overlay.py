"""The verb ``overlay``: estimates on the images they were made from."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_text
from graspcast.cli.options import (
    Verbs,
    add_inputs,
    add_out,
    field_size,
    inputs_of,
    new_verb,
    scene_and_image,
)
from graspcast.errors import InputError, UnknownNameError

if TYPE_CHECKING:
    from graspcast.bop.dataset import BopDataset

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``overlay``."""
    verb = new_verb(
        verbs,
        "overlay",
        _overlay,
        "estimates drawn on the dataset's images",
        "Draw estimates on the images they were made from, the paper's Figure 1: the true pose\n"
        "solid where it is known, the estimate green; with errors and, if asked, verdicts.\n"
        "A field for each object in each image; several estimators are side by side.\n\n"
        "Verdicts with several views are shown with the number of views. The pose that guides\n"
        "the grasp, such as the fused one, is a further outline. Where the verdict is to look\n"
        "again, an arrow points to the side to which the camera should go.",
    )
    add_inputs(verb, bop_required=True)
    verb.add_argument(
        "--image",
        metavar="SCENE/IMAGE",
        type=scene_and_image,
        action="append",
        required=True,
        help="an image to be drawn on; may be repeated",
    )
    verb.add_argument(
        "--verdicts",
        metavar="FILE",
        type=Path,
        help="what predict wrote; shown below the pictures of the principal's estimates, and those "
        "by the fused pose below the first estimate of the instance",
    )
    verb.add_argument(
        "--size", metavar="PIXELS", type=field_size, default=320, help="of a field (default: 320)"
    )
    add_out(verb, "the sheet (.png)")


def _overlay(options: argparse.Namespace) -> None:
    from graspcast.forecasting.verdict_file import read_verdicts
    from graspcast.rendering.drawing import save_png
    from graspcast.rendering.overlay_sheet import overlay_sheet, overlays

    if options.out.suffix.lower() != ".png":
        raise InputError(f"{options.out}: a sheet of overlays is drawn to .png")
    inputs = inputs_of(options)
    if len(inputs.results) != 1:
        raise InputError(
            f"these are estimates of {' and '.join(inputs.results)}; draw one dataset at a time"
        )
    ((name, results),) = inputs.results.items()
    wanted = _wanted(options.objects, inputs.datasets[name])
    verdicts = None if options.verdicts is None else read_verdicts(options.verdicts)
    images = list(dict.fromkeys(options.image))
    fields = overlays(inputs.datasets[name], results, images, verdicts=verdicts, size=options.size)
    for missing in sorted(wanted - {field.object for field in fields}):
        raise InputError(f"--objects {missing}: no estimate of it in any --image")
    save_png(options.out, overlay_sheet(fields, estimators=len(results), size=options.size))
    note(*inputs.notes, *inputs.lengths)
    print_text(str(options.out))


def _wanted(objects: list[str], dataset: BopDataset) -> set[str]:
    """Return the names of ``--objects``, all of which the dataset must know."""
    known = [f"{dataset.name}-{number}" for number in sorted(dataset.models.info)]
    names = {text if "-" in text else f"{dataset.name}-{text}" for text in objects}
    for name in sorted(names - set(known)):
        raise UnknownNameError("object", name, known)
    return names
