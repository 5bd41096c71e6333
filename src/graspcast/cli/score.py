"""The verb ``score``: verdicts against the outcomes of the grasps."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_table
from graspcast.cli.cost_options import add_costs, costs_of, print_thresholds
from graspcast.cli.options import Verbs, add_json, add_outcomes, new_verb, write_json
from graspcast.io.wording import counted

if TYPE_CHECKING:
    from graspcast.evaluation.look_scores import LookScores

__all__ = ["add", "print_policies"]


def add(verbs: Verbs) -> None:
    """Add the verb ``score``."""
    verb = new_verb(
        verbs,
        "score",
        _score,
        "how often grasps succeed if the verdicts are followed",
        "Score verdicts by outcomes: the success rate when always attempting, the one when\n"
        "following the verdicts, and how many are attempted then; with 95 % intervals over\n"
        "scenes. The outcomes should be of scenes that training has not seen. Verdicts and\n"
        "outcomes are joined by dataset, image, object, est_id, principal, gripper and grasp.\n\n"
        "With --stages: what looking again is worth, beside one look and always all looks.\n\n"
        "A table says what other thresholds would be worth on these grasps.",
    )
    what = verb.add_mutually_exclusive_group(required=True)
    what.add_argument("--verdicts", metavar="FILE", type=Path, help="what predict has written")
    what.add_argument(
        "--stages",
        metavar="FILE",
        type=Path,
        help="the verdicts after each look, from predict --stages; the outcomes should be of all "
        "guides: of the principal, and of fused2, fused3 and so on",
    )
    add_outcomes(verb, required=True)
    add_costs(verb)
    add_json(verb)


def print_policies(found: LookScores, title: str, *, attempts: bool = False) -> None:
    """Print what policies are worth.

    Parameters
    ----------
    found
        Their scores.
    title
        Of the table.
    attempts
        Whether to print how many attempts there are, too.
    """
    header = ["", "success rate", "attempt rate", "attempts", "mean looks"]
    rows = [
        [
            p.name,
            "-" if p.success is None else str(p.success),
            str(p.attempt_rate),
            str(p.attempts),
            f"{p.looks:.2f}",
        ]
        for p in found.policies
    ]
    if not attempts:
        header, rows = header[:3] + header[4:], [row[:3] + row[4:] for row in rows]
    print_table(title, header, rows)


def _score(options: argparse.Namespace) -> None:
    if options.stages:
        _score_stages(options)
    else:
        _score_verdicts(options)


def _score_stages(options: argparse.Namespace) -> None:
    from graspcast.estimates.outcomes import read_all_outcomes
    from graspcast.evaluation.look_scores import score_looks, stages_of
    from graspcast.evaluation.threshold_table import threshold_table
    from graspcast.evaluation.threshold_trials import threshold_in_use, trials_of_looks
    from graspcast.forecasting.stage_file import read_stages

    outcomes = read_all_outcomes(options.outcomes)
    looks = read_stages(options.stages)
    found = score_looks(stages_of(looks, outcomes))
    if found.untried:
        note(f"left out {counted(found.untried, 'instance')} without an outcome after some look")
    title = f"{counted(found.n, 'grasp')} in {counted(found.scenes, 'scene')}"
    title += ", 95 % intervals over scenes"
    print_policies(found, title, attempts=True)
    most = threshold_in_use([row for each in looks for row in each.rows])
    table = threshold_table(
        trials_of_looks(looks, outcomes), costs_of(options), asked=most, most=most
    )
    print_thresholds(table, options, "looking again")
    write_json(options.json, {**found.as_dict(), "thresholds": table.as_dict()})


def _score_verdicts(options: argparse.Namespace) -> None:
    from graspcast.estimates.outcomes import read_all_outcomes
    from graspcast.evaluation.threshold_table import threshold_table
    from graspcast.evaluation.threshold_trials import threshold_in_use, trials_of_verdicts
    from graspcast.evaluation.verdict_scores import score_verdicts
    from graspcast.forecasting.verdict_file import read_verdicts

    verdicts, outcomes = read_verdicts(options.verdicts), read_all_outcomes(options.outcomes)
    found = score_verdicts(verdicts, outcomes)
    if found.untried:
        note(f"left out {counted(found.untried, 'verdict')} without an outcome")
    if found.following is None:
        note("nothing is attempted, so there is no success rate when following the verdicts")
    rows = [
        ("always attempting", str(found.always), "1.000", str(found.n)),
        (
            "following the verdicts",
            "-" if found.following is None else str(found.following),
            str(found.attempt_rate),
            str(found.attempts),
        ),
    ]
    if found.gain is not None:
        rows.append(("difference", f"{found.gain:+}", "", ""))
    title = f"{counted(found.n, 'grasp')} in {counted(found.scenes, 'scene')}"
    title += ", 95 % intervals over scenes"
    print_table(title, ["", "success rate", "attempt rate", "attempts"], rows)
    table = threshold_table(
        trials_of_verdicts(verdicts, outcomes),
        costs_of(options),
        asked=threshold_in_use(verdicts),
    )
    print_thresholds(table, options, "views as they were")
    write_json(options.json, {**found.as_dict(), "thresholds": table.as_dict()})
