"""Grippers: the built-in ones, and custom ones from an MJCF model."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path

from graspcast.errors import UnknownNameError
from graspcast.io.arguments import PATH, checked
from graspcast.simulation.grippers.franka import FrankaHand
from graspcast.simulation.grippers.mjcf import MjcfGripper
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.grippers.tendon_hand import TendonHand

__all__ = ["GRIPPERS", "FrankaHand", "MjcfGripper", "TendonHand", "load_gripper"]

GRIPPERS: dict[str, Callable[[], Gripper]] = {"parallel": FrankaHand, "underactuated": TendonHand}
"""Built-in grippers by the paper's names."""

_OTHER_NAMES = {"franka": "parallel", "tendon_hand": "underactuated"}


@checked(name_or_path=PATH)
def load_gripper(name_or_path: str | PathLike[str]) -> Gripper:
    """Load a built-in gripper by name, or a custom one from its TOML file.

    Parameters
    ----------
    name_or_path
        ``"parallel"`` (or ``"franka"``), ``"underactuated"`` (or ``"tendon_hand"``), or a path
        that ends in ``.toml``.

    Raises
    ------
    UnknownNameError
        If there is no such built-in gripper.
    FormatError
        If the TOML or MJCF file does not describe a gripper.
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
            hint="A custom gripper is given by its .toml file.",
            parameters=("gripper",),
        )
    return GRIPPERS[name]()
