"""Options of one trial, and the trial that they ask for, recorded."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_text
from graspcast.cli.options import (
    add_bop,
    add_estimates,
    add_tables,
    bop_dirs_of,
    note_sizes,
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

__all__ = ["RecordedTrial", "add_trial", "record"]


@dataclass(frozen=True, eq=False)
class RecordedTrial:
    """A trial and its recording.

    Attributes
    ----------
    recording
        What happened.
    runner
        Object, gripper and settings.
    title
        Object and gripper, in words.
    """

    recording: Recording
    runner: TrialRunner
    title: str


def add_trial(verb: argparse.ArgumentParser, *, built_in: bool = False) -> None:
    """Add the options of one trial, but for object and gripper; ``built_in`` as add_estimates."""
    add_estimates(verb, required=False, built_in=built_in)
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


def record(options: argparse.Namespace) -> RecordedTrial:
    """Run the trial of the options, and print its outcome."""
    from graspcast.rendering.trials.film import describe
    from graspcast.simulation.grasps.table import read_grasps
    from graspcast.simulation.grippers import load_gripper
    from graspcast.simulation.objects.catalogue import read_catalogue
    from graspcast.simulation.objects.load import load_object
    from graspcast.simulation.trial.recording import record_trial
    from graspcast.simulation.trial.trial import TrialRunner

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
    return RecordedTrial(recording, runner, f"{catalogue[name].label} ({name}), {gripper.name}")


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
