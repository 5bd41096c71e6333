"""The verb ``validate-sim``: simulated against published outcomes."""

from __future__ import annotations

import argparse
from pathlib import Path

from graspcast.cli.console import note, print_text
from graspcast.cli.options import (
    Verbs,
    add_json,
    new_verb,
    write_json,
)
from graspcast.cli.progress import progress_bar

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``validate-sim``."""
    verb = new_verb(
        verbs,
        "validate-sim",
        _validate_sim,
        "simulate every published trial and compare",
        "Simulate every published trial. Print Table I (paper and ours) and, for each object and\n"
        "gripper, the agreement of the outcomes on the train, validation and test images. The\n"
        "same command resumes an interrupted run.",
    )
    verb.add_argument(
        "--data",
        metavar="DIR",
        type=Path,
        required=True,
        help="holds published/ (what import-release writes) and bop/",
    )
    verb.add_argument(
        "--grasps",
        metavar="FILE",
        type=Path,
        help="reference grasps (TOML) besides the built-in ones",
    )
    verb.add_argument(
        "--workers", metavar="N", type=int, help="worker processes (default: all cores)"
    )
    verb.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        help="directory of the campaign (default: next to --json)",
    )
    verb.set_defaults(directories=("out",))
    add_json(verb)


def _validate_sim(options: argparse.Namespace) -> None:
    from graspcast.paper.dataset import Published
    from graspcast.paper.validation import render_cells, render_table1, validate
    from graspcast.simulation.campaign.executors import LocalExecutor
    from graspcast.simulation.grasps.table import read_grasps

    out = options.out or (options.json or Path("validation.json")).with_suffix(".campaign")
    data = Published(options.data)
    note(*data.lengths)
    with progress_bar("simulating") as move:
        found = validate(
            data,
            read_grasps(options.grasps, protocol="paper"),
            out,
            executor=LocalExecutor(options.workers),
            progress=move,
        )
    print_text("## Agreement with the published outcomes\n\n" + render_cells(found))
    print_text("\n## Table I, paper and ours\n\n" + render_table1(found) + "\n")
    for name, value in found["summary"].items():
        print_text(f"{name.replace('_', ' ')}: {value}")
    write_json(options.json, found)
