"""The verb ``simulate``: grasp trials guided by estimates."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_table, print_text
from graspcast.cli.error_options import add_covariance, add_tails, drawn_errors
from graspcast.cli.options import (
    Verbs,
    add_inputs,
    add_out,
    count,
    inputs_of,
    new_verb,
    note_sizes,
    positive,
)
from graspcast.cli.progress import progress_bar
from graspcast.cli.protocol_options import add_protocol, settings_of
from graspcast.errors import InputError
from graspcast.io.wording import counted

if TYPE_CHECKING:
    from polars import DataFrame

    from graspcast.estimates.loading import Inputs
    from graspcast.simulation.campaign.executors import Executor
    from graspcast.simulation.campaign.pose_errors import PoseErrors
    from graspcast.simulation.campaign.requests import TrialRequests
    from graspcast.simulation.grasps.table import GraspTable

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``simulate``."""
    verb = new_verb(
        verbs,
        "simulate",
        _simulate,
        "grasp trials guided by estimates",
        "Simulate the grasp that each estimate would guide, and store the outcomes in a directory\n"
        "of Parquet files. The same command resumes an interrupted campaign. Objects without a\n"
        "reference grasp or a mesh are left out and counted, unless --objects names them.",
    )
    add_inputs(verb, bop_required=True, required=False)
    verb.add_argument(
        "--gripper",
        metavar="NAME",
        action="append",
        required=True,
        help="name, or the .toml file of a custom one; may be repeated",
    )
    verb.add_argument(
        "--transferred-errors",
        metavar="N",
        type=int,
        help="instead, N trials of each grasp with errors made on other objects (--estimates) or\n"
        "drawn (--deviations, --covariances); --objects names objects that may have no images",
    )
    add_covariance(verb, "from which --transferred-errors are drawn")
    add_tails(verb)
    verb.add_argument(
        "--seed", metavar="N", type=count, default=0, help="random seed of --transferred-errors"
    )
    _add_grasps(verb)
    verb.add_argument(
        "--catalogue", metavar="FILE", type=Path, help="objects (TOML) besides the built-in ones"
    )
    add_protocol(verb)
    verb.add_argument(
        "--workers", metavar="N", type=int, help="worker processes (default: all cores)"
    )
    verb.add_argument(
        "--executor", choices=("local", "ray"), default="local", help="default: local"
    )
    verb.add_argument(
        "--address", metavar="URL", help="address of the Ray cluster, if it is not found"
    )
    add_out(verb, "directory of the campaign; an interrupted campaign is resumed", directory=True)


def _add_grasps(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--grasps",
        metavar="FILE",
        type=Path,
        help="reference grasps (TOML) besides the built-in ones",
    )
    verb.add_argument(
        "--grasp",
        metavar="NAME",
        action="append",
        default=[],
        help="only grasps of this name; may be repeated (default: all)",
    )
    verb.add_argument(
        "--max-grasps",
        metavar="N",
        type=positive,
        help="at most this many grasps of each object and gripper, the first of the file",
    )


def _executor(options: argparse.Namespace) -> Executor:
    from graspcast.simulation.campaign.executors import LocalExecutor

    if options.executor == "local":
        if options.address is not None:
            raise InputError("an address is for the executor ray", parameters=("executor",))
        return LocalExecutor(options.workers)
    if options.workers is not None:
        raise InputError(
            "a Ray cluster has as many workers as cores; limit them when you start Ray on a node",
            parameters=("workers",),
        )
    from graspcast.simulation.campaign.ray_executor import RayExecutor

    return RayExecutor(options.address)


def _strict(options: argparse.Namespace) -> bool:
    """Whether each object must be simulated, because it was asked for."""
    return bool(options.objects) and not options.lenient


def _requests(
    options: argparse.Namespace,
    inputs: Inputs,
    errors: PoseErrors | None,
    grasps: GraspTable,
    grippers: tuple[str, ...],
) -> TrialRequests:
    from graspcast.simulation.campaign.from_estimates import trials_from_estimates
    from graspcast.simulation.campaign.transferred_errors import trials_from_transferred_errors

    if errors is None:
        return trials_from_estimates(
            inputs.results,
            inputs.datasets,
            grippers,
            grasps=grasps,
            strict=_strict(options),
            notes=inputs.notes,
        )
    objects = options.objects or inputs.objects
    if not objects:
        raise InputError("name the objects of the trials", parameters=("objects",))
    pairs = grasps.pairs(objects, grippers, strict=_strict(options))
    lacking = sorted({(o, g) for o in objects for g in grippers} - set(pairs))
    if lacking:
        names = ", ".join(f"{name} by {gripper}" for name, gripper in lacking)
        inputs.notes.append(f"left out what has no grasp: {names}")
    return trials_from_transferred_errors(
        errors,
        [reference.grasp for pair in pairs for reference in grasps.of(*pair)],
        count=options.transferred_errors,
        seed=options.seed,
    )


def _inputs(options: argparse.Namespace, drawn: PoseErrors | None) -> Inputs:
    """Load the estimates; where errors are drawn there are none, but models."""
    from graspcast.bop.dataset import BopDataset
    from graspcast.estimates.loading import Inputs

    transferred = options.transferred_errors is not None
    if drawn is not None:
        if not transferred:
            raise InputError(
                "drawn errors are for trials of objects without images: say how many of each",
                parameters=("transferred_errors",),
            )
        found = [BopDataset(root, name=name, sensor=options.sensor) for name, root in options.bop]
        return Inputs({dataset.name: dataset for dataset in found}, {})
    if not options.estimates:
        either = ", or standard deviations by which to draw their errors" * transferred
        raise InputError(
            f"give estimates{either}", parameters=("estimates", *(["deviations"] * transferred))
        )
    # Errors are transferred from all objects; --objects names those that they are transferred to.
    return inputs_of(options, every_object=transferred)


def _simulate(options: argparse.Namespace) -> None:
    from graspcast.simulation.campaign.campaign import run_campaign
    from graspcast.simulation.campaign.jobs import available_trials, load_setups
    from graspcast.simulation.campaign.pose_errors import PoseErrors, sources_of
    from graspcast.simulation.grasps.table import read_grasps
    from graspcast.simulation.grippers import load_grippers
    from graspcast.simulation.objects.catalogue import read_catalogue

    executor = _executor(options)
    drawn = drawn_errors(options)
    inputs = _inputs(options, drawn)
    errors = drawn
    if errors is None and options.transferred_errors is not None:
        errors = PoseErrors.of_estimates(inputs.results, inputs.datasets)
    grippers = load_grippers(options.gripper)
    settings = {name: settings_of(options, gripper) for name, gripper in grippers.items()}
    table = read_grasps(options.grasps, protocol=options.protocol)
    grasps = table.limited(options.grasp, options.max_grasps)
    requests = _requests(options, inputs, errors, grasps, tuple(grippers))
    bop_dirs = {name: dataset.root for name, dataset in inputs.datasets.items()}
    catalogue = read_catalogue(options.catalogue)
    if not _strict(options):
        requests = available_trials(requests, inputs.notes, bop_dirs=bop_dirs, catalogue=catalogue)
    note(*inputs.notes, *inputs.lengths)
    setups = load_setups(
        requests,
        grasps,
        settings=settings,
        bop_dirs=bop_dirs,
        catalogue=catalogue,
        grippers=grippers,
    )
    note_sizes(
        {setup.grasp_object.name: setup.grasp_object for setup in setups.values()}.values(),
        {setup.gripper.name: setup.gripper for setup in setups.values()}.values(),
    )
    if drawn is not None:
        note(*(f"{name}: {told}" for name, told in drawn.sources.items()))
    with progress_bar("simulating") as move:
        outcomes = run_campaign(
            requests,
            setups,
            options.out,
            executor=executor,
            sources=sources_of(inputs.results) if errors is None else errors.sources,
            progress=move,
        )
    _print_outcomes(outcomes)
    print_text(f"{options.out}: {counted(len(outcomes), 'trial')}")


def _print_outcomes(outcomes: DataFrame) -> None:
    """Print the reasons of each grasp, and which of them mostly collide."""
    from graspcast.estimates.outcomes import REFERENCE_GRASP
    from graspcast.simulation.campaign.campaign import (
        always_missed,
        mostly_collided,
        reason_counts,
    )

    counts = reason_counts(outcomes)
    if counts["grasp"].unique().to_list() == [REFERENCE_GRASP]:
        shown = counts.drop("grasp")
    else:
        shown = counts
    rows = [
        tuple(f"{value:.3f}" if isinstance(value, float) else str(value) for value in row)
        for row in shown.rows()
    ]
    print_table("Outcomes", shown.columns, rows)
    if often := mostly_collided(counts):
        note(
            f"most trials collide: {', '.join(often)}; graspcast grasps shows whether the "
            "grasp does so with a perfect estimate"
        )
    if never := always_missed(counts):
        note(
            f"every trial misses: {', '.join(never)}; is the grasp the pose of the tool centre "
            "point, not of the gripper's base? graspcast grasps shows it"
        )
