"""The grippers that come with graspcast, and how any other is loaded."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path

from graspcast.errors import UnknownNameError
from graspcast.simulation.grippers.franka import FrankaHand
from graspcast.simulation.grippers.mjcf import MjcfGripper
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.grippers.tendon_hand import TendonHand

__all__ = ["GRIPPERS", "FrankaHand", "MjcfGripper", "TendonHand", "load_gripper"]

GRIPPERS: dict[str, Callable[[], Gripper]] = {"parallel": FrankaHand, "underactuated": TendonHand}
"""The built-in grippers, by the paper's words for them."""

_OTHER_NAMES = {"franka": "parallel", "tendon_hand": "underactuated"}


def load_gripper(name_or_path: str | PathLike[str]) -> Gripper:
    """A built-in gripper by its name, or a user's own from its TOML file.

    Parameters
    ----------
    name_or_path
        ``"parallel"`` (or ``"franka"``), ``"underactuated"`` (or ``"tendon_hand"``), or a path that
        ends in ``.toml``.

    Raises
    ------
    UnknownNameError
        For a name that is neither.
    FormatError
        For a TOML or MJCF that does not describe a gripper.
    """
    path = Path(name_or_path)
    if path.suffix == ".toml":
        return MjcfGripper.from_toml(path)
    name = _OTHER_NAMES.get(str(name_or_path), str(name_or_path))
    if name not in GRIPPERS:
        raise UnknownNameError(
            "gripper",
            name_or_path,
            [*GRIPPERS, *_OTHER_NAMES],
            hint="An own gripper is given by its .toml file.",
        )
    return GRIPPERS[name]()
