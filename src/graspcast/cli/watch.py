"""The verb ``watch``: one grasp trial as a film, or in a window."""

from __future__ import annotations

import argparse
from pathlib import Path

from graspcast.cli.console import print_text
from graspcast.cli.one_trial import RecordedTrial, add_trial, record
from graspcast.cli.options import Verbs, add_pair, new_verb, note_software_drawing
from graspcast.cli.progress import progress_bar, waiting
from graspcast.errors import InputError

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``watch``."""
    verb = new_verb(
        verbs,
        "watch",
        _watch,
        "one grasp trial as a film, or in a window",
        "Run one grasp trial and show it as a film (.mp4, .gif), as a strip of pictures (.png)\n"
        "or, without --out, in MuJoCo's viewer. The object is orange, the estimate green. The\n"
        "estimate is perfect, or has the error --offset, or is from a results CSV (--estimates,\n"
        "--bop, --image).",
    )
    add_pair(verb, "lmo-5")
    add_trial(verb)
    verb.add_argument(
        "--size",
        metavar="WxH",
        type=_size,
        help="pixels of a picture (default: 640x480, in a strip 400x480)",
    )
    verb.add_argument(
        "--out", metavar="PATH", type=Path, help=".mp4 or .gif for a film, .png for a strip"
    )


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError(f"WxH is needed, for example 640x480, not {text!r}")
    size = int(width), int(height)
    # The encoder takes even numbers only.
    if any(side % 2 or not 64 <= side <= 4096 for side in size):
        raise argparse.ArgumentTypeError(f"even numbers from 64 to 4096 are needed, not {text!r}")
    return size


def _watch(options: argparse.Namespace) -> None:
    if options.out is None:
        from graspcast.rendering.trials.viewer import check_display

        check_display()
    from graspcast.rendering.trials.film import suffixes

    if options.out is not None and options.out.suffix.lower() not in suffixes():
        raise InputError(
            f"{options.out}: the suffix must be one of {', '.join(suffixes())}",
            parameters=("out",),
        )
    trial = record(options)
    if options.out is None:
        from graspcast.rendering.trials.viewer import replay

        grasp_object, gripper = trial.runner.grasp_object, trial.runner.gripper
        with waiting():
            replay(trial.recording, grasp_object, gripper, collision=options.collision)
    else:
        _draw(options, trial)
        print_text(str(options.out))


def _draw(options: argparse.Namespace, trial: RecordedTrial) -> None:
    from graspcast.rendering.trials.film import save_film, save_strip
    from graspcast.rendering.trials.renderer import SceneRenderer

    note_software_drawing()
    strip = options.out.suffix.lower() == ".png"
    width, height = options.size or ((400, 480) if strip else (640, 480))
    with SceneRenderer(
        trial.runner.grasp_object,
        trial.runner.gripper,
        width=width,
        height=height,
        collision=options.collision,
    ) as renderer:
        if strip:
            save_strip(options.out, trial.recording, renderer, trial.title)
            return
        with progress_bar("drawing") as move:
            save_film(options.out, trial.recording, renderer, trial.title, progress=move)
