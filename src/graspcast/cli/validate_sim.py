"""The verb ``validate-sim``: simulated against published outcomes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import print_text, progress_bar
from graspcast.cli.options import (
    Verbs,
    add_json,
    new_verb,
    write_json,
)
from graspcast.cli.simulate import words_of

if TYPE_CHECKING:
    from graspcast.simulation.grasps.observed_trials import ObservedTrials

__all__ = ["add", "published_trials"]


def add(verbs: Verbs) -> None:
    """Add the verb ``validate-sim``."""
    verb = new_verb(
        verbs,
        "validate-sim",
        _validate_sim,
        "simulate every published trial and compare",
        "Simulate every trial that was published and print Table I (paper | ours) and, for each\n"
        "object and gripper, how well the outcomes agree on the images that took no part in\n"
        "fitting or choosing grasps. Started again, it goes on from where it was.",
    )
    verb.add_argument(
        "--data",
        metavar="DIR",
        type=Path,
        required=True,
        help="holds published/ (what import-release writes) and bop/",
    )
    verb.add_argument("--grasps", metavar="FILE", type=Path, help="beside the built-in grasps")
    verb.add_argument("--workers", metavar="N", type=int, help="default: all cores")
    verb.add_argument(
        "--out", metavar="DIR", type=Path, help="the campaign (default: beside --json or here)"
    )
    add_json(verb)


def published_trials(directory: Path) -> tuple[ObservedTrials, dict[str, Path]]:
    """Return the published trials, and the datasets' BOP directories."""
    from graspcast.bop.results import read_results
    from graspcast.paper.dataset import DATASETS, ESTIMATORS, Published
    from graspcast.simulation.grasps.observed_trials import observed_trials

    data = Published(directory)
    # The paper's tables count placeholders for 'nothing found' as estimates.
    results = {
        name: {e: read_results(data.results_path(e, name), placeholders=True) for e in ESTIMATORS}
        for name in DATASETS
    }
    trials = observed_trials(results, data.bop, data.outcomes)
    return trials, {name: dataset.root for name, dataset in data.bop.items()}


def _validate_sim(options: argparse.Namespace) -> None:
    from graspcast.paper.validation import compare, render_cells, render_table1
    from graspcast.simulation.campaign.campaign import run_campaign
    from graspcast.simulation.campaign.executors import LocalExecutor
    from graspcast.simulation.campaign.jobs import load_setups
    from graspcast.simulation.grasps.search import jitter_held
    from graspcast.simulation.grasps.table import read_grasps

    trials, bop_dirs = published_trials(options.data)
    grasps = read_grasps(options.grasps)
    pairs = load_setups(trials.requests, grasps, bop_dirs=bop_dirs)
    directory = options.out or (options.json or Path("validation.json")).with_suffix(".campaign")
    with progress_bar("trying grasps") as move:
        outcomes = run_campaign(
            trials.requests,
            pairs,
            directory,
            executor=LocalExecutor(options.workers),
            progress=lambda p: move(p.done / p.total, words_of(p)),
        )
        held = {}
        for i, (pair, what) in enumerate(pairs.items()):
            move(i / len(pairs), f"perfect estimates of {pair[0]} by {pair[1]}")
            held[pair] = jitter_held(what.runner(), what.grasp)[0]
    found = compare(trials, outcomes, grasps, held)
    print_text("## Agreement with the published outcomes\n\n" + render_cells(found))
    print_text("\n## Table I, paper and ours\n\n" + render_table1(found) + "\n")
    for name, value in found["summary"].items():
        print_text(f"{name.replace('_', ' ')}: {value}")
    write_json(options.json, found)
