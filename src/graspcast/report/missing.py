"""What is missing from a report, and the commands that make it."""

from __future__ import annotations

import shlex

from graspcast.report.content import Missing
from graspcast.report.run_data import RunData

__all__ = ["missing_of"]


def missing_of(run: RunData, notes: tuple[str, ...] = ()) -> tuple[Missing, ...]:
    """Return what a run lacks, and how to get it.

    Parameters
    ----------
    run
        The run.
    notes
        What was left out of the report for other reasons.
    """
    out = [Missing(text) for text in (*run.problems, *notes)]
    lacking = {
        _VERDICTS: run.decisions is None,
        _OUTCOMES: not run.trials,
        _ERRORS: bool(run.trials) and not _has_errors(run),
        _LOOKS: run.decisions is not None and run.decisions.most_looks == 1,
        Missing("The model's card.", f"{_again(run)} --model model.npz"): not run.cards,
        _CERTIFICATE: not run.certificates,
        Missing(
            "Images and models, so pictures of the grasps and errors of the estimates.",
            f"{_again(run)} --bop DIR",
        ): not run.datasets,
        _TOLERANCE: not run.tolerances,
        _COMPARISON: len({name for tables in run.results.values() for name in tables}) > 1,
        _COMMANDS: not run.commands,
    }
    return (*out, *(item for item, lacks in lacking.items() if lacks))


def _has_errors(run: RunData) -> bool:
    return any(one.table["error_x_m"].is_not_null().any() for one in run.trials)


def _again(run: RunData) -> str:
    directory = run.files.directory
    return f"graspcast report {'...' if directory is None else shlex.quote(str(directory))}"


_VERDICTS = Missing(
    "Verdicts, so whether following them pays.",
    "graspcast predict --estimates NAME=FILE ... --model model.npz --out verdicts.csv",
)
_OUTCOMES = Missing(
    "Outcomes, so success rates, risk-coverage and reliability: simulated or real.",
    "graspcast simulate --bop DIR --estimates NAME=FILE --gripper NAME --out trials",
)
_ERRORS = Missing(
    "The errors of the poses that guided trials, so errors against success; campaigns of "
    "graspcast simulate state them."
)
_LOOKS = Missing(
    "Verdicts after further looks, so what looking again is worth.",
    "graspcast predict ... --camera-poses DIR --max-looks 3 --stages stages.csv",
)
_CERTIFICATE = Missing(
    "A certificate of the success rate, from outcomes of scenes that training has not seen.",
    "graspcast certify --model model.npz --estimates NAME=FILE ... --outcomes trials "
    "--out certificate.json",
)
_TOLERANCE = Missing(
    "Tolerance maps.",
    "graspcast tolerance --object NAME --gripper NAME --json tolerance.json",
)
_COMPARISON = Missing(
    "Which estimator should guide, and what each supporter is worth, by cross-validation.",
    "graspcast compare --bop DIR --estimates NAME=FILE ... --gripper NAME --outcomes trials",
)
_COMMANDS = Missing("The commands that made the run: keep them as commands.sh beside it.")
