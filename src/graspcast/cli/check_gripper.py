"""TODO."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from graspcast.cli.console import print_text

if TYPE_CHECKING:
    pass

__all__ = []


def _check_gripper(options: argparse.Namespace) -> None:
    from graspcast.errors import InputError
    from graspcast.simulation.grippers import load_gripper
    from graspcast.simulation.trial.gripper_conformance import check_gripper

    report = check_gripper(load_gripper(options.gripper))
    print_text(str(report))
    if not report.passed:
        names = ", ".join(check.name for check in report.failures)
        raise InputError(f"{options.gripper} does not pass: {names}")
