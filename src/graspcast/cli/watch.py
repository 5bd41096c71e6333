"""The verb ``watch``: one grasp trial as a film, or in a window."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspcast.cli.console import note, print_text, progress_bar
from graspcast.cli.options import (
    Verbs,
    add_bop,
    add_estimates,
    add_tables,
    bop_dirs_of,
    new_verb,
    note_software_drawing,
    scene_and_image,
)
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
        "Run one grasp trial and show it: as a film (.mp4, .gif) or a strip of pictures (.png),\n"
        "or, without --out, in MuJoCo's viewer. The object is orange, the estimate green. It\n"
        "is the trial of a perfect estimate, of one off by --offset, or of one in a results CSV\n"
        "(--estimates, --bop, --image).",
    )
    verb.add_argument("--object", metavar="NAME", required=True, help="for example lmo-5")
    verb.add_argument("--gripper", metavar="NAME", required=True, help="or an own one's .toml")
    add_estimates(verb, required=False)
    add_bop(verb)
    verb.add_argument(
        "--image",
        metavar="SCENE/IMAGE",
        type=scene_and_image,
        help="which image's estimate is to be tried",
    )
    verb.add_argument(
        "--instance",
        metavar="N",
        type=int,
        default=0,
        help="which of several of the object in that image, by score (default: 0)",
    )
    verb.add_argument(
        "--offset",
        metavar=("X", "Y", "Z", "RX", "RY", "RZ"),
        nargs=6,
        type=float,
        help="the estimate's error in the object's frame: mm, and a rotation vector in degrees",
    )
    add_tables(verb)
    verb.add_argument(
        "--full", action="store_true", help="the whole lift, not only until the outcome is certain"
    )
    verb.add_argument(
        "--size",
        metavar="WxH",
        type=_size,
        help="pixels of a picture (default: 640x480, in a strip 400x480)",
    )
    verb.add_argument("--out", metavar="PATH", type=Path, help=".mp4, .gif, or .png for a strip")


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
    from graspcast.rendering.opengl_context import import_mujoco

    import_mujoco()
    if options.out is None:
        from graspcast.rendering.trials.viewer import check_display

        check_display()
    from graspcast.rendering.trials.film import describe, endings
    from graspcast.simulation.grasps.table import read_grasps
    from graspcast.simulation.grippers import load_gripper
    from graspcast.simulation.objects.catalogue import read_catalogue
    from graspcast.simulation.objects.load import load_object
    from graspcast.simulation.trial.recording import record_trial
    from graspcast.simulation.trial.trial import TrialRunner

    if options.out is not None and options.out.suffix.lower() not in endings():
        raise InputError(f"{options.out}: a trial is drawn to {', '.join(endings())}")
    catalogue = read_catalogue(options.catalogue)
    name = catalogue[options.object].name
    gripper = load_gripper(options.gripper)
    reference = read_grasps(options.grasps)(name, gripper.name)
    obj_T_est = _estimate(options, catalogue[name])
    target = load_object(name, bop_dirs=bop_dirs_of(options), catalogue=catalogue)
    runner = TrialRunner(reference.applied_to(target), gripper)
    recording = record_trial(runner, obj_T_est, reference.grasp, early_stop=not options.full)
    outcome = recording.outcome
    print_text(
        f"{name} ({catalogue[name].label}), {gripper.name} gripper: {describe(outcome)} "
        f"({outcome.simulated_s:.2f} s simulated)"
    )
    if not outcome.steps and outcome.reason == "missed":
        note("the hand never comes near the object; --full shows the whole trial")
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
    """``obj_T_est`` as the options say: perfect, off by ``--offset``, or from a results CSV."""
    import numpy as np

    from graspcast.pose.transforms import rotation_from_vector, transform

    if not options.estimates:
        if options.image is not None:
            raise InputError("--image picks an estimate: give --estimates NAME=FILE and --bop too")
        offset = np.array(options.offset or 6 * [0.0])
        if not np.isfinite(offset).all():
            raise InputError(f"--offset takes six finite numbers, not {options.offset}")
        return transform(rotation_from_vector(np.radians(offset[3:])), offset[:3] / 1000)
    if options.offset is not None:
        raise InputError("--offset and --estimates both say what the estimate is; give one")
    if len(options.estimates) != 1 or options.image is None or not options.bop:
        raise InputError(
            "to try an estimate of a results CSV, give --estimates once, --bop for its ground "
            "truth, and --image SCENE/IMAGE"
        )
    return _read_estimate(options, entry)


def _read_estimate(options: argparse.Namespace, entry: ObjectEntry) -> Float[ndarray, "4 4"]:
    from graspcast.estimates.alignment import rows_in_image
    from graspcast.estimates.loading import load_inputs
    from graspcast.estimates.matching import match
    from graspcast.pose.transforms import invert

    if entry.obj_id is None:
        raise InputError(f"object {entry.name} is of no BOP dataset, so no results CSV is about it")
    name = f"{entry.dataset}-{entry.obj_id}"
    inputs = load_inputs(
        options.estimates, bop=options.bop, ground_truth=options.ground_truth, objects=[name]
    )
    ((dataset, tables),) = inputs.results.items()
    (results,) = tables.values()
    truth = inputs.datasets[dataset].ground_truth
    scene_id, im_id = options.image
    if dataset != entry.dataset:
        raise InputError(f"{results.source}: estimates of {dataset}, of which {name} is none")
    rows = rows_in_image(results, scene_id, im_id, name)
    if not 0 <= options.instance < len(rows):
        raise InputError(
            f"--instance {options.instance}: image {scene_id}/{im_id} has {len(rows)} of {name}, "
            "counted from 0"
        )
    row = rows[options.instance]
    matched = match(results, truth)[row]
    if matched < 0:
        raise InputError(
            f"{truth.source}: no ground truth for {name} in image {scene_id}/{im_id}, instance "
            f"{options.instance}"
        )
    pose: Any = invert(truth.cam_T_obj[matched]) @ results.cam_T_obj[row]
    return pose
