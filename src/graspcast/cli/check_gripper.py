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
        "whether an own gripper is fit for trials",
        "Check that a gripper, given as MJCF with a short TOML, does what trials need of one: it\n"
        "opens, closes, settles, holds, drops, and does the same again.",
    )
    verb.add_argument("gripper", metavar="FILE", help="the gripper's .toml, or a built-in's name")


def _check_gripper(options: argparse.Namespace) -> None:
    from graspcast.errors import InputError
    from graspcast.simulation.grippers import load_gripper
    from graspcast.simulation.trial.gripper_conformance import check_gripper

    report = check_gripper(load_gripper(options.gripper))
    print_text(str(report))
    if not report.passed:
        names = ", ".join(check.name for check in report.failures)
        raise InputError(f"{options.gripper} does not pass: {names}")
