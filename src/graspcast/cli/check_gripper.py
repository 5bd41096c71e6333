"""The verb ``check-gripper``: conformance of a gripper."""

from __future__ import annotations

import argparse

from graspcast.cli.console import print_text
from graspcast.cli.options import (
    Verbs,
    new_verb,
)

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``check-gripper``."""
    verb = new_verb(
        verbs,
        "check-gripper",
        _check_gripper,
        "check a gripper for trials",
        "Run the conformance checks on a gripper, given as an MJCF model with a TOML file: it\n"
        "must open, close, come to rest, hold, drop, and give the same outcome again.",
    )
    verb.add_argument(
        "gripper", metavar="FILE", help="TOML file of a gripper, or name of a built-in one"
    )


def _check_gripper(options: argparse.Namespace) -> None:
    from graspcast.errors import InputError
    from graspcast.simulation.grippers import load_gripper
    from graspcast.simulation.trial.gripper_conformance import check_gripper

    report = check_gripper(load_gripper(options.gripper))
    print_text(str(report))
    if not report.passed:
        names = ", ".join(check.name for check in report.failures)
        raise InputError(f"{options.gripper} does not pass: {names}")
