"""The verb ``score``: verdicts against the outcomes of the grasps."""

from __future__ import annotations

import argparse
from pathlib import Path

from graspcast.cli.console import note, print_table
from graspcast.cli.options import Verbs, add_json, add_outcomes, new_verb, write_json

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``score``."""
    verb = new_verb(
        verbs,
        "score",
        _score,
        "how often grasps succeed if the verdicts are followed",
        "Score verdicts by outcomes: the success rate when always attempting, the one when\n"
        "following the verdicts, and how many are attempted then; with 95 % intervals by drawing\n"
        "scenes. The outcomes should be of scenes that training has not seen. Verdicts and\n"
        "outcomes are joined by dataset, image, object, est_id, principal, gripper and grasp.",
    )
    verb.add_argument(
        "--verdicts", metavar="FILE", type=Path, required=True, help="what predict has written"
    )
    add_outcomes(verb, required=True)
    add_json(verb)


def _score(options: argparse.Namespace) -> None:
    from graspcast.estimates.outcomes import read_all_outcomes
    from graspcast.evaluation.verdict_scores import score_verdicts
    from graspcast.forecasting.verdict_file import read_verdicts

    found = score_verdicts(
        read_verdicts(options.verdicts),
        read_all_outcomes(options.outcomes),
    )
    if found.untried:
        note(f"{found.untried} verdicts have no outcome, and do not count")
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
    title = f"{found.n} grasps in {found.scenes} scenes, 95 % intervals by drawing scenes"
    print_table(title, ["", "success rate", "attempt rate", "attempts"], rows)
    write_json(options.json, found.as_dict())
