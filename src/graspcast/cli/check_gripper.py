"""The verb ``check-gripper``: conformance of a gripper, and what it measures."""

from __future__ import annotations

import argparse
from pathlib import Path

from graspcast.cli.console import note, print_table, print_text
from graspcast.cli.options import Verbs, new_verb, note_software_drawing
from graspcast.cli.progress import progress_bar

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``check-gripper``."""
    verb = new_verb(
        verbs,
        "check-gripper",
        _check_gripper,
        "check a gripper for trials",
        "Run the conformance checks on a gripper: it must open, close, come to rest, hold, drop,\n"
        "and give the same outcome again. Measure in simulation where and along which direction\n"
        "its fingers close, how wide they open and how hard they press, and print that beside\n"
        "what the gripper states.",
    )
    verb.add_argument(
        "gripper", metavar="GRIPPER", help="TOML file of a gripper, or name of a built-in one"
    )
    verb.add_argument(
        "--picture",
        metavar="FILE",
        type=Path,
        help="draw the gripper with the axes of its tool centre point (.png)",
    )


def _check_gripper(options: argparse.Namespace) -> None:
    from graspcast.errors import InputError

    if options.picture is not None and options.picture.suffix.lower() != ".png":
        raise InputError(f"{options.picture}: the picture is a .png file", parameters=("picture",))
    from graspcast.simulation.grippers import load_gripper
    from graspcast.simulation.trial.gripper_conformance import check_gripper

    gripper = load_gripper(options.gripper)
    with progress_bar("checking"):
        report = check_gripper(gripper)
    note(*report.notes)
    print_text(str(report))
    if report.measured is not None:
        print_table("In simulation", ["", "measured", "stated"], report.measured.rows(gripper))
        if any(check.name in ("aligned", "centred") for check in report.failures):
            print_text(f"Measured, for its TOML file:\n{report.measured.as_toml()}")
    if options.picture is not None:
        from graspcast.rendering.trials.gripper_picture import save_gripper_picture

        note_software_drawing()
        save_gripper_picture(options.picture, gripper, report.measured)
        print_text(str(options.picture))
    if not report.passed:
        names = ", ".join(check.name for check in report.failures)
        raise InputError(f"{options.gripper} does not pass: {names}")
