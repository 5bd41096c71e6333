"""Options of trials: by which protocol they are run, and the limit of contact force."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

from graspcast.cli.numbers import number_type
from graspcast.errors import InputError

if TYPE_CHECKING:
    from graspcast.simulation.grippers.protocol import Gripper
    from graspcast.simulation.trial.settings import TrialSettings

__all__ = ["add_protocol", "settings_of"]


def add_protocol(verb: argparse.ArgumentParser) -> None:
    """Add ``--protocol`` and ``--contact-force``."""
    verb.add_argument(
        "--protocol",
        choices=("robot", "paper"),
        default="robot",
        help="robot: a trial ends as collided when the hand meets something on the approach;\n"
        "paper: it is blocked if the hand would end in the object, else the arm presses on;\n"
        "reproduces published outcomes, with grasps fitted to them (default: robot)",
    )
    verb.add_argument(
        "--contact-force",
        metavar="N",
        type=_newtons,
        help="force on the hand at which the arm stops (default: that of the gripper's .toml\n"
        "file, or 40)",
    )


_newtons = number_type(lambda value: 0 < value < math.inf, "a force above zero, in newtons, is")


def settings_of(options: argparse.Namespace, gripper: Gripper) -> TrialSettings:
    """Return the settings of trials with a gripper that the options ask for.

    Raises
    ------
    InputError
        If a limit is given for the protocol that has none.
    """
    from graspcast.simulation.trial.settings import TrialSettings

    if options.protocol == "robot":
        return TrialSettings.robot(gripper, contact_force_n=options.contact_force)
    if options.contact_force is not None:
        raise InputError(
            "by the paper's protocol the arm does not stop at a force; leave out --contact-force, "
            "or give --protocol robot"
        )
    return TrialSettings.paper()
