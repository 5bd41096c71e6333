"""The verb ``watch``: one grasp trial as a film, or in a window."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_text, progress_bar
from graspcast.cli.options import (
    Verbs,
    add_bop,
    add_estimates,
    add_pair,
    add_tables,
    bop_dirs_of,
    new_verb,
    note_sizes,
    note_software_drawing,
    scene_and_image,
)
from graspcast.cli.protocol_options import add_protocol, settings_of
from graspcast.errors import InputError

if TYPE_CHECKING:
    from jaxtyping import Float
    from numpy import ndarray

    from graspcast.simulation.objects.catalogue import ObjectEntry
    from graspcast.simulation.trial.recording import Recording
    from graspcast.simulation.trial.trial import TrialRunner

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
    add_estimates(verb, required=False)
    add_bop(verb)
    verb.add_argument(
        "--image",
        metavar="SCENE/IMAGE",
        type=scene_and_image,
        help="image of the estimate",
    )
    verb.add_argument(
        "--est-id",
        metavar="N",
        type=int,
        default=0,
        help="number of the estimate among those of the object in the image, by score (default: 0)",
    )
    verb.add_argument(
        "--offset",
        metavar=("X", "Y", "Z", "RX", "RY", "RZ"),
        nargs=6,
        type=float,
        help="error of the estimate in the object's frame: mm, and a rotation vector in degrees",
    )
    add_tables(verb)
    add_protocol(verb)
    verb.add_argument(
        "--full", action="store_true", help="simulate the full lift, without early stopping"
    )
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
    from graspcast.rendering.trials.film import describe, suffixes
    from graspcast.simulation.grasps.table import read_grasps
    from graspcast.simulation.grippers import load_gripper
    from graspcast.simulation.objects.catalogue import read_catalogue
    from graspcast.simulation.objects.load import load_object
    from graspcast.simulation.trial.recording import record_trial
    from graspcast.simulation.trial.trial import TrialRunner

    if options.out is not None and options.out.suffix.lower() not in suffixes():
        raise InputError(
            f"{options.out}: the suffix must be one of {', '.join(suffixes())}",
            parameters=("out",),
        )
    catalogue = read_catalogue(options.catalogue)
    name = catalogue[options.object].name
    gripper = load_gripper(options.gripper)
    settings = settings_of(options, gripper)
    reference = read_grasps(options.grasps, protocol=options.protocol)(name, gripper.name)
    obj_T_est = _estimate(options, catalogue[name])
    target = load_object(name, bop_dirs=bop_dirs_of(options), catalogue=catalogue)
    runner = TrialRunner(reference.applied_to(target), gripper, settings)
    note_sizes([runner.grasp_object], [gripper])
    recording = record_trial(runner, obj_T_est, reference.grasp, early_stop=not options.full)
    outcome = recording.outcome
    print_text(
        f"{name} ({catalogue[name].label}), {gripper.name} gripper: {describe(outcome)} "
        f"({outcome.simulated_s:.2f} s simulated)"
    )
    if not outcome.steps and outcome.reason == "missed":
        note("the hand never comes near the object; --full shows the full trial")
    if options.out is None:
        from graspcast.rendering.trials.viewer import replay

        replay(recording, runner.grasp_object, gripper, collision=options.collision)
    else:
        _draw(options, recording, runner, f"{catalogue[name].label} ({name}), {gripper.name}")
        print_text(str(options.out))


def _draw(
    options: argparse.Namespace, recording: Recording, runner: TrialRunner, title: str
) -> None:
    from graspcast.rendering.trials.film import save_film, save_strip
    from graspcast.rendering.trials.renderer import SceneRenderer

    note_software_drawing()
    strip = options.out.suffix.lower() == ".png"
    width, height = options.size or ((400, 480) if strip else (640, 480))
    with SceneRenderer(
        runner.grasp_object,
        runner.gripper,
        width=width,
        height=height,
        collision=options.collision,
    ) as renderer:
        if strip:
            save_strip(options.out, recording, renderer, title)
            return
        with progress_bar("drawing") as move:
            save_film(options.out, recording, renderer, title, progress=move)


def _estimate(options: argparse.Namespace, entry: ObjectEntry) -> Float[ndarray, "4 4"]:
    """Return ``obj_T_est`` from the options: perfect, with an error, or from a results CSV."""
    from graspcast.estimates.loading import load_inputs
    from graspcast.simulation.trial.estimate import estimate_in_image, estimate_with_error

    if not options.estimates:
        if options.image is not None:
            raise InputError("--image also needs --estimates NAME=FILE and --bop")
        return estimate_with_error(options.offset or 6 * [0.0])
    if options.offset is not None:
        raise InputError("--offset and --estimates exclude each other; give one")
    if len(options.estimates) != 1 or options.image is None or not options.bop:
        raise InputError(
            "an estimate of a results CSV needs --estimates once, --bop for its ground truth, and "
            "--image SCENE/IMAGE"
        )
    if entry.obj_id is None:
        raise InputError(f"object {entry.name} is in no BOP dataset, so it has no results CSV")
    name = f"{entry.dataset}-{entry.obj_id}"
    inputs = load_inputs(
        options.estimates,
        bop=options.bop,
        ground_truth=options.ground_truth,
        objects=[name],
        sensor=options.sensor,
    )
    ((dataset, tables),) = inputs.results.items()
    (results,) = tables.values()
    if dataset != entry.dataset:
        raise InputError(f"{results.source}: its estimates are of {dataset}, not of {name}")
    truth = inputs.datasets[dataset].ground_truth
    note(*inputs.lengths)
    return estimate_in_image(results, truth, name, options.image, options.est_id)
