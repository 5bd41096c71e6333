"""The verb ``fit-grasp``: a reference grasp that agrees with given outcomes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_table, print_text, progress_bar
from graspcast.cli.options import (
    Verbs,
    add_inputs,
    add_json,
    add_out,
    add_outcomes,
    inputs_of,
    new_verb,
    write_json,
)
from graspcast.cli.validate_sim import published_trials
from graspcast.errors import InputError

if TYPE_CHECKING:
    from graspcast.simulation.grasps.observed_trials import ObservedTrials

__all__ = ["add"]

_DATA = "holds published/ (what import-release writes) and bop/"


def add(verbs: Verbs) -> None:
    """Add the verb ``fit-grasp``."""
    verb = new_verb(
        verbs,
        "fit-grasp",
        _fit_grasp,
        "search a reference grasp that agrees with given outcomes",
        "Search the reference grasp of an object by a gripper under which simulated outcomes\n"
        "agree best with given ones: on a first part of the images, choosing on a second, and\n"
        "reporting on a third that the search never sees. Writes or replaces it in a TOML file.",
    )
    verb.add_argument("--data", metavar="DIR", type=Path, help=f"{_DATA}; or name the inputs:")
    add_inputs(verb, required=False)
    add_outcomes(verb, required=False)
    verb.add_argument("--object", metavar="NAME", required=True, help="for example lmo-5")
    verb.add_argument("--gripper", metavar="NAME", required=True, help="or an own one's .toml")
    verb.add_argument(
        "--catalogue", metavar="FILE", type=Path, help="objects (TOML) beside the built-in ones"
    )
    verb.add_argument("--seed", metavar="N", type=int, default=0, help="of everything random")
    verb.add_argument(
        "--budget",
        metavar="X",
        type=float,
        default=1.0,
        help="how much to try, 1 being some 2,000 trials (default: 1)",
    )
    verb.add_argument(
        "--contradicted",
        action="store_true",
        help="do not demand that a perfect estimate is held: the given outcomes contradict it",
    )
    add_out(verb, "the TOML file of grasps")
    add_json(verb)


def _trials_of(options: argparse.Namespace) -> tuple[ObservedTrials, dict[str, Path]]:
    """The trials that the options name, and the datasets' BOP directories."""
    from graspcast.estimates.loading import load_outcomes
    from graspcast.simulation.grasps.observed_trials import observed_trials

    if options.data is not None:
        return published_trials(options.data)
    if not (options.estimates and options.bop and options.outcomes):
        raise InputError("give --data, or else --estimates, --bop and --outcomes")
    inputs = inputs_of(options)
    names = sorted({name for tables in inputs.results.values() for name in tables})
    trials = observed_trials(
        inputs.results, inputs.datasets, load_outcomes(options.outcomes, names)
    )
    note(*inputs.notes)
    return trials, {name: dataset.root for name, dataset in inputs.datasets.items()}


def _fit_grasp(options: argparse.Namespace) -> None:
    from dataclasses import asdict

    from graspcast.simulation.grasps.search import SearchEffort, fit_grasp, report_grasp
    from graspcast.simulation.grasps.table import grasps_in, read_grasps, write_grasps
    from graspcast.simulation.grippers import load_gripper
    from graspcast.simulation.objects.catalogue import read_catalogue
    from graspcast.simulation.objects.load import load_object

    trials, bop_dirs = _trials_of(options)
    gripper = load_gripper(options.gripper)
    grasp_object = load_object(
        options.object, bop_dirs=bop_dirs, catalogue=read_catalogue(options.catalogue)
    )
    pair = (grasp_object.name, gripper.name)
    mine = grasps_in(options.out) if options.out.exists() else []
    known = read_grasps().updated(mine)
    with progress_bar("searching") as move:
        found = fit_grasp(
            grasp_object,
            gripper,
            trials.of(*pair, "fit"),
            trials.of(*pair, "choose"),
            seed=options.seed,
            effort=SearchEffort().scaled(options.budget),
            start=[known(*pair).grasp.obj_T_grasp] if pair in known else [],
            hold_perfect=not options.contradicted,
            progress=lambda words, done, best: move(done, f"{words}, best {best:.3f}"),
        )
    reported = report_grasp(found, grasp_object, gripper, trials.of(*pair, "report"))
    reference = found.reference(options.seed, reported)
    rows = [[name.replace("_", " "), str(value)] for name, value in reference.agreement.items()]
    print_table(f"{pair[0]} by {pair[1]}", ["", ""], rows)
    others = [r for r in mine if (r.grasp.object, r.grasp.gripper) != pair]
    write_grasps(options.out, [*others, reference])
    print_text(f"{options.out}: {len(others) + 1} grasps")
    write_json(options.json, {"report": asdict(reported), **reference.agreement})
