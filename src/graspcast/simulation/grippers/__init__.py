"""Grippers: built-in ones, those of MuJoCo Menagerie, and custom ones from MJCF or URDF."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from os import PathLike
from pathlib import Path

from graspcast.errors import FormatError, InputError, UnknownNameError
from graspcast.io.arguments import PATH, checked
from graspcast.simulation.grippers.franka import FrankaHand
from graspcast.simulation.grippers.menagerie import load_menagerie_gripper, menagerie_names
from graspcast.simulation.grippers.mjcf import MjcfGripper
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.grippers.tendon_hand import TendonHand

__all__ = ["GRIPPERS", "FrankaHand", "MjcfGripper", "TendonHand", "load_gripper", "load_grippers"]

GRIPPERS: dict[str, Callable[[], Gripper]] = {"parallel": FrankaHand, "underactuated": TendonHand}
"""Built-in grippers by the paper's names."""

_OTHER_NAMES = {"franka": "parallel", "tendon_hand": "underactuated"}


@checked(name_or_path=PATH)
def load_gripper(name_or_path: str | PathLike[str]) -> Gripper:
    """Load a gripper by name, or a custom one from its TOML file.

    Parameters
    ----------
    name_or_path
        ``"parallel"`` (or ``"franka"``), ``"underactuated"`` (or ``"tendon_hand"``), a hand of
        MuJoCo Menagerie such as ``"robotiq_2f85"``, or a path that ends in ``.toml``.

    Raises
    ------
    UnknownNameError
        If there is no gripper of that name.
    InputError
        If the model of a hand of MuJoCo Menagerie is not at hand.
    FormatError
        If the TOML or model file does not describe a gripper, or has a name that is taken.
    """
    path = Path(name_or_path)
    if path.suffix == ".toml":
        custom = MjcfGripper.from_toml(path)
        if custom.name in (*GRIPPERS, *_OTHER_NAMES, *menagerie_names()):
            raise FormatError(
                path,
                f"name is {custom.name!r}, which is that of a built-in gripper; its outcomes and "
                "reference grasps would be taken for those of this one: give another name",
            )
        return custom
    name = _OTHER_NAMES.get(str(name_or_path), str(name_or_path))
    if name in GRIPPERS:
        return GRIPPERS[name]()
    if name in menagerie_names():
        return load_menagerie_gripper(name)
    raise UnknownNameError(
        "gripper",
        name_or_path,
        [*GRIPPERS, *_OTHER_NAMES, *menagerie_names()],
        hint="A custom gripper is given by its .toml file.",
        parameters=("gripper",),
    )


def load_grippers(names_or_paths: Iterable[str | PathLike[str]]) -> dict[str, Gripper]:
    """Load several grippers, by name.

    Raises
    ------
    InputError
        As :func:`load_gripper`, or if two have one name; the message names both.
    """
    grippers: dict[str, Gripper] = {}
    given: dict[str, str | PathLike[str]] = {}
    for source in names_or_paths:
        gripper = load_gripper(source)
        if gripper.name in grippers:
            raise InputError(
                f"two grippers are called {gripper.name!r}: {given[gripper.name]} and {source}; "
                "give each once, and another name",
                parameters=("gripper",),
            )
        grippers[gripper.name], given[gripper.name] = gripper, source
    return grippers
