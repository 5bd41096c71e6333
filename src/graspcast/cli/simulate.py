"""The verb ``simulate``: grasp trials guided by estimates."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_table, print_text, progress_bar
from graspcast.cli.options import (
    Verbs,
    add_inputs,
    add_out,
    inputs_of,
    new_verb,
    note_sizes,
)
from graspcast.cli.protocol_options import add_protocol, settings_of
from graspcast.io.wording import counted

if TYPE_CHECKING:
    from graspcast.estimates.loading import Inputs
    from graspcast.simulation.campaign.executors import Executor
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
    add_inputs(verb, bop_required=True)
    verb.add_argument(
        "--gripper",
        metavar="NAME",
        action="append",
        required=True,
        help="parallel, underactuated, or the .toml file of a custom one; may be repeated",
    )
    verb.add_argument(
        "--transferred-errors",
        metavar="N",
        type=int,
        help="instead, N trials of each object with errors made on other objects; --objects names\n"
        "objects that may have no images",
    )
    verb.add_argument(
        "--seed", metavar="N", type=int, default=0, help="random seed of --transferred-errors"
    )
    verb.add_argument(
        "--grasps",
        metavar="FILE",
        type=Path,
        help="reference grasps (TOML) besides the built-in ones",
    )
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


def _executor(options: argparse.Namespace) -> Executor:
    from graspcast.simulation.campaign.executors import LocalExecutor, RayExecutor

    if options.executor == "ray":
        return RayExecutor(options.address)
    return LocalExecutor(options.workers)


def _strict(options: argparse.Namespace) -> bool:
    """Whether each object must be simulated, because it was asked for."""
    return bool(options.objects) and not options.lenient


def _requests(
    options: argparse.Namespace, inputs: Inputs, grasps: GraspTable, grippers: tuple[str, ...]
) -> TrialRequests:
    from graspcast.simulation.campaign.from_estimates import trials_from_estimates
    from graspcast.simulation.campaign.transferred_errors import trials_from_transferred_errors

    if options.transferred_errors is None:
        return trials_from_estimates(
            inputs.results,
            inputs.datasets,
            grippers,
            grasps=None if _strict(options) else grasps,
            notes=inputs.notes,
        )
    objects = options.objects or inputs.objects
    pairs = grasps.pairs(objects, grippers, strict=bool(options.objects))
    lacking = sorted({(o, g) for o in objects for g in grippers} - set(pairs))
    if lacking:
        names = ", ".join(f"{name} by {gripper}" for name, gripper in lacking)
        inputs.notes.append(f"left out what has no reference grasp: {names}")
    return trials_from_transferred_errors(
        inputs.results,
        inputs.datasets,
        pairs,
        count=options.transferred_errors,
        seed=options.seed,
    )


def _simulate(options: argparse.Namespace) -> None:
    from graspcast.simulation.campaign.campaign import (
        mostly_collided,
        reason_counts,
        run_campaign,
    )
    from graspcast.simulation.campaign.jobs import available_trials, load_setups
    from graspcast.simulation.grasps.table import read_grasps
    from graspcast.simulation.grippers import load_grippers
    from graspcast.simulation.objects.catalogue import read_catalogue

    # Errors are transferred from all objects; --objects names those that they are transferred to.
    inputs = inputs_of(options, every_object=options.transferred_errors is not None)
    grippers = load_grippers(options.gripper)
    settings = {name: settings_of(options, gripper) for name, gripper in grippers.items()}
    grasps = read_grasps(options.grasps, protocol=options.protocol)
    requests = _requests(options, inputs, grasps, tuple(grippers))
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
        [setup.grasp_object for setup in setups.values()],
        {setup.gripper.name: setup.gripper for setup in setups.values()}.values(),
    )
    sources = {
        f"{estimator} on {name}": table.source
        for name, tables in inputs.results.items()
        for estimator, table in tables.items()
    }
    with progress_bar("simulating") as move:
        outcomes = run_campaign(
            requests,
            setups,
            options.out,
            executor=_executor(options),
            sources=sources,
            progress=move,
        )
    counts = reason_counts(outcomes)
    rows = [(name, hand, f"{rate:.3f}", *map(str, n)) for name, hand, rate, *n in counts.rows()]
    print_table("Outcomes", counts.columns, rows)
    print_text(f"{options.out}: {counted(len(outcomes), 'trial')}")
    if often := mostly_collided(counts):
        note(
            f"most trials collide: {', '.join(often)}; graspcast grasps shows whether the "
            "reference grasp does so with a perfect estimate"
        )
