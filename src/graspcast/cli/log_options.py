"""The option ``--from-log``: attempt logs in place of files of estimates and outcomes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.errors import InputError

if TYPE_CHECKING:
    from graspcast.attempt_log import AttemptLog
    from graspcast.attempt_log.recorded import Recorded

__all__ = ["add_from_log", "check_sources", "logs_of", "recorded_of"]


def add_from_log(verb: argparse.ArgumentParser, what: str) -> None:
    """``--from-log LOG``, which may be repeated."""
    verb.add_argument(
        "--from-log",
        metavar="LOG",
        type=Path,
        action="append",
        default=[],
        help=f"an attempt log, {what}; may be repeated, and takes the place of --estimates and "
        "--outcomes",
    )


def check_sources(options: argparse.Namespace, *, outcomes: bool) -> None:
    """Check that data are given either as files or as logs.

    Parameters
    ----------
    options
        Those of the verb.
    outcomes
        Whether files of outcomes are needed too.
    """
    both = [name for name in ("estimates", "outcomes") if getattr(options, name)]
    if options.from_log and both:
        raise InputError(
            "a log holds estimates and outcomes: give either logs, or files of both",
            parameters=("from_log", *both),
        )
    if not options.from_log and not options.estimates:
        raise InputError(
            "there are no estimates: give their files, or an attempt log",
            parameters=("estimates", "from_log"),
        )
    if outcomes and not options.from_log and not options.outcomes:
        raise InputError(
            "there are no outcomes: give their files, or an attempt log",
            parameters=("outcomes", "from_log"),
        )


def logs_of(options: argparse.Namespace) -> list[AttemptLog]:
    """Open the logs that ``--from-log`` names."""
    from graspcast.attempt_log import AttemptLog

    return [AttemptLog.read(path) for path in options.from_log]


def recorded_of(options: argparse.Namespace) -> Recorded:
    """Read the logs that ``--from-log`` names, with the datasets that ``--bop`` does."""
    from graspcast.attempt_log.recorded import recorded
    from graspcast.estimates.directories import named_directories, open_directories

    for name in ("images", "scenes"):
        if getattr(options, name, None):
            raise InputError(f"a log has no {name}", parameters=("from_log", name))
    named = named_directories(options.bop, options.ground_truth)
    datasets = open_directories(named, [], options.sensor)
    return recorded(logs_of(options), datasets=datasets, objects=options.objects)
