"""The verb ``simulate``: grasp trials guided by estimates."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_table, print_text, progress_bar
from graspcast.cli.options import (
    Verbs,
    add_inputs,
    add_out,
    inputs_of,
    new_verb,
)

if TYPE_CHECKING:
    from graspcast.estimates.loading import Inputs
    from graspcast.simulation.campaign.campaign import Progress
    from graspcast.simulation.campaign.executors import Executor
    from graspcast.simulation.grasps.table import GraspTable

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``simulate``."""
    verb = new_verb(
        verbs,
        "simulate",
        _simulate,
        "grasp trials guided by estimates",
        "Try in simulation the grasp that each estimate would guide, and keep the outcomes in a\n"
        "directory of Parquet files. Killed at any moment and started again, it goes on from\n"
        "where it was. --lenient leaves out objects without a reference grasp.",
    )
    add_inputs(verb, bop_required=True)
    verb.add_argument(
        "--gripper",
        metavar="NAME",
        action="append",
        required=True,
        help="parallel, underactuated, or an own gripper's .toml; may be repeated",
    )
    verb.add_argument(
        "--transferred-errors",
        metavar="N",
        type=int,
        help="instead, N trials of each object by errors that the estimators made on the others;\n"
        "an object of one's own (--objects) needs no image of itself",
    )
    verb.add_argument("--seed", metavar="N", type=int, default=0, help="of what is borrowed")
    verb.add_argument(
        "--grasps", metavar="FILE", type=Path, help="reference grasps (TOML) beside the built-in"
    )
    verb.add_argument(
        "--catalogue", metavar="FILE", type=Path, help="objects (TOML) beside the built-in ones"
    )
    verb.add_argument(
        "--workers", metavar="N", type=int, help="worker processes (default: all cores)"
    )
    verb.add_argument(
        "--executor", choices=("local", "ray"), default="local", help="default: local"
    )
    verb.add_argument("--address", metavar="URL", help="of the Ray cluster, if not found by itself")
    add_out(verb, "the campaign's directory; one that holds part of it is gone on with")


def _executor(options: argparse.Namespace) -> Executor:
    from graspcast.simulation.campaign.executors import LocalExecutor, RayExecutor

    if options.executor == "ray":
        return RayExecutor(options.address)
    return LocalExecutor(options.workers)


def words_of(progress: Progress) -> str:
    """A campaign's progress, for beside its bar."""
    left = progress.left_s
    remaining = f", {left / 60:.0f} min left" if 60 <= left < float("inf") else ""
    return f"{progress.done} of {progress.total} trials, {progress.rate:.1f}/s{remaining}"


def _pairs(
    wanted: Sequence[str], inputs: Inputs, grasps: GraspTable, grippers: Sequence[str]
) -> list[tuple[str, str]]:
    """The wanted objects, or all that the estimates are of, with each gripper that grasps them."""
    from graspcast.errors import InputError

    seen = {
        f"{dataset}-{number}"
        for dataset, tables in inputs.results.items()
        for table in tables.values()
        for number in set(table.obj_id.tolist())
    }
    odd = [name for name in wanted if not name.rpartition("-")[0] or not name[-1].isdecimal()]
    if odd:
        raise InputError(
            f"--transferred-errors needs --objects as DATASET-NUMBER (lmo-5), not {odd[0]!r}"
        )
    pairs = [(name, gripper) for name in sorted(wanted or seen) for gripper in grippers]
    known = [pair for pair in pairs if pair in grasps]
    if not known or (wanted and len(known) < len(pairs)):
        lacking = ", ".join(f"{o} by {g}" for o, g in pairs if (o, g) not in known)
        raise InputError(f"no reference grasp of {lacking}; give one with --grasps")
    return known


def _simulate(options: argparse.Namespace) -> None:
    from graspcast.simulation.campaign.campaign import run_campaign
    from graspcast.simulation.campaign.from_estimates import trials_from_estimates
    from graspcast.simulation.campaign.jobs import load_setups
    from graspcast.simulation.campaign.transferred_errors import trials_from_transferred_errors
    from graspcast.simulation.grasps.table import read_grasps
    from graspcast.simulation.grippers import load_gripper
    from graspcast.simulation.objects.catalogue import read_catalogue

    wanted = options.objects
    if options.transferred_errors is not None:
        options.objects = []  # the others' errors are what is borrowed
    inputs = inputs_of(options)
    grippers = {hand.name: hand for hand in map(load_gripper, options.gripper)}
    grasps = read_grasps(options.grasps)
    if options.transferred_errors is None:
        requests = trials_from_estimates(
            inputs.results,
            inputs.datasets,
            tuple(grippers),
            grasps=grasps if options.lenient else None,
            notes=inputs.notes,
        )
    else:
        requests = trials_from_transferred_errors(
            inputs.results,
            inputs.datasets,
            _pairs(wanted, inputs, grasps, tuple(grippers)),
            count=options.transferred_errors,
            seed=options.seed,
        )
    note(*inputs.notes)
    pairs = load_setups(
        requests,
        grasps,
        bop_dirs={name: dataset.root for name, dataset in inputs.datasets.items()},
        catalogue=read_catalogue(options.catalogue),
        grippers=grippers,
    )
    sources = {
        f"{estimator} on {name}": table.source
        for name, tables in inputs.results.items()
        for estimator, table in tables.items()
    }
    with progress_bar("trying grasps") as move:
        outcomes = run_campaign(
            requests,
            pairs,
            options.out,
            executor=_executor(options),
            sources=sources,
            progress=lambda p: move(p.done / p.total, words_of(p)),
        )
    keys = ["object", "gripper"]
    counts = outcomes.pivot("reason", index=keys, values="steps", aggregate_function="len")
    reasons = [c for c in counts.columns if c not in keys]
    rows = []
    for row in counts.sort(keys).iter_rows(named=True):
        counts_here = [row[reason] or 0 for reason in reasons]
        rate = (row.get("held") or 0) / sum(counts_here)
        rows.append([row["object"], row["gripper"], f"{rate:.3f}", *map(str, counts_here)])
    print_table("Outcomes", ["object", "gripper", "success", *reasons], rows)
    print_text(f"{options.out}: {len(outcomes)} trials")
