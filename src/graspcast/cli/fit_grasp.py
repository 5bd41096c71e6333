"""The verb ``fit-grasp``: search for a reference grasp that agrees with observed outcomes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_table, print_text
from graspcast.cli.options import (
    Verbs,
    add_inputs,
    add_json,
    add_out,
    add_outcomes,
    add_pair,
    inputs_of,
    new_verb,
    note_sizes,
    write_json,
)
from graspcast.cli.progress import progress_bar
from graspcast.errors import InputError

if TYPE_CHECKING:
    from graspcast.simulation.grasps.observed_trials import ObservedTrials
    from graspcast.simulation.grippers.protocol import Gripper
    from graspcast.simulation.trial.settings import TrialSettings

__all__ = ["add"]

_DATA = "holds published/ (what import-release writes) and bop/"


def add(verbs: Verbs) -> None:
    """Add the verb ``fit-grasp``."""
    verb = new_verb(
        verbs,
        "fit-grasp",
        _fit_grasp,
        "search for a reference grasp that agrees with observed outcomes",
        "Search for the reference grasp of an object by a gripper with which simulated outcomes\n"
        "agree best with observed ones. The images are split into train (search), validation\n"
        "(choice among finalists) and test (agreement reported). Adds the grasp to a TOML file.",
    )
    verb.add_argument("--data", metavar="DIR", type=Path, help=f"{_DATA}; or name the inputs:")
    add_inputs(verb, required=False)
    add_outcomes(verb, required=False)
    add_pair(verb, "lmo-5")
    verb.add_argument(
        "--catalogue", metavar="FILE", type=Path, help="objects (TOML) besides the built-in ones"
    )
    verb.add_argument("--seed", metavar="N", type=int, default=0, help="random seed")
    verb.add_argument(
        "--budget",
        metavar="X",
        type=float,
        default=1.0,
        help="size of the search; 1 is about 2,000 trials (default: 1)",
    )
    verb.add_argument(
        "--no-require-perfect-hold",
        dest="require_perfect_hold",
        action="store_false",
        help="allow a grasp that drops a perfect estimate, if the observed outcomes say so",
    )
    add_out(verb, "the TOML file of grasps")
    add_json(verb)


def _settings(options: argparse.Namespace, gripper: Gripper) -> TrialSettings:
    """Return the paper's protocol for published outcomes, the robot's for one's own."""
    from graspcast.simulation.trial.settings import TrialSettings

    return TrialSettings.robot(gripper) if options.data is None else TrialSettings.paper()


def _trials_of(options: argparse.Namespace) -> tuple[ObservedTrials, dict[str, Path]]:
    """Load the trials that the options name, and the BOP directories of their datasets."""
    from graspcast.estimates.loading import load_outcomes
    from graspcast.simulation.grasps.observed_trials import observed_trials

    if options.data is not None:
        from graspcast.paper.dataset import Published
        from graspcast.paper.validation import published_trials

        data = Published(options.data)
        note(*data.lengths)
        return published_trials(data), {name: dataset.root for name, dataset in data.bop.items()}
    if not (options.estimates and options.bop and options.outcomes):
        raise InputError(
            "give --data, or else --estimates, --bop and --outcomes. The search needs outcomes of "
            "real trials; without them, graspcast propose-grasps finds grasps"
        )
    inputs = inputs_of(options)
    names = sorted({name for tables in inputs.results.values() for name in tables})
    trials = observed_trials(
        inputs.results, inputs.datasets, load_outcomes(options.outcomes, names)
    )
    note(*inputs.notes, *inputs.lengths)
    return trials, {name: dataset.root for name, dataset in inputs.datasets.items()}


def _fit_grasp(options: argparse.Namespace) -> None:
    from dataclasses import asdict

    from graspcast.simulation.grasps.evaluation import evaluate_grasp
    from graspcast.simulation.grasps.search import SearchEffort, fit_grasp
    from graspcast.simulation.grasps.table import grasps_in, read_grasps, write_grasps
    from graspcast.simulation.grippers import load_gripper
    from graspcast.simulation.objects.catalogue import read_catalogue
    from graspcast.simulation.objects.load import load_object

    trials, bop_dirs = _trials_of(options)
    gripper = load_gripper(options.gripper)
    settings = _settings(options, gripper)
    grasp_object = load_object(
        options.object, bop_dirs=bop_dirs, catalogue=read_catalogue(options.catalogue)
    )
    note_sizes([grasp_object], [gripper])
    pair = (grasp_object.name, gripper.name)
    mine = grasps_in(options.out) if options.out.exists() else []
    known = read_grasps(protocol=settings.protocol).updated(mine)
    with progress_bar("searching") as move:
        found = fit_grasp(
            grasp_object,
            gripper,
            trials.of(*pair, "train"),
            trials.of(*pair, "validation"),
            seed=options.seed,
            effort=SearchEffort().scaled(options.budget),
            start=[known(*pair).grasp.obj_T_grasp] if pair in known else [],
            require_perfect_hold=options.require_perfect_hold,
            settings=settings,
            progress=move,
        )
    test = evaluate_grasp(
        found.reference, grasp_object, gripper, trials.of(*pair, "test"), settings=settings
    )
    reference = found.with_test(test, options.seed)
    rows = [[name.replace("_", " "), str(value)] for name, value in reference.agreement.items()]
    print_table(f"{pair[0]} by {pair[1]}", ["", ""], rows)
    others = [r for r in mine if str(r.grasp) != str(reference.grasp)]
    write_grasps(options.out, [*others, reference])
    print_text(f"{options.out}: {len(others) + 1} grasps")
    write_json(options.json, {"test": asdict(test), **reference.agreement})
