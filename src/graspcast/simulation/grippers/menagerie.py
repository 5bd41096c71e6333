"""Hands of MuJoCo Menagerie, by name; their models come from the package ``mujoco-menagerie``.

The package downloads a robot's files when they are first needed, and keeps them. Where it is not
installed, or there is no network, the environment variable ``MENAGERIE_ROOT`` names a checkout of
the menagerie, as it does for the package itself.
"""

from __future__ import annotations

import os
from pathlib import Path

from graspcast.errors import InputError
from graspcast.io.toml import TomlTable, read_toml
from graspcast.simulation.grippers.mjcf import MjcfGripper

__all__ = ["MENAGERIE", "load_menagerie_gripper", "menagerie_names"]

MENAGERIE = Path(__file__).parent / "menagerie.toml"
"""How each hand is used: tool centre point, opening and commands."""

_ROOT = "MENAGERIE_ROOT"
_INSTALL = "pip install --no-deps mujoco-menagerie"


def menagerie_names() -> list[str]:
    """Return the names of the hands."""
    return list(read_toml(MENAGERIE))


def load_menagerie_gripper(name: str) -> MjcfGripper:
    """Load a hand of the menagerie.

    Parameters
    ----------
    name
        One of :func:`menagerie_names`.

    Raises
    ------
    InputError
        If its model is not at hand: the package is not installed, the files cannot be downloaded,
        or the checkout lacks them. The message says what to do.
    """
    table = TomlTable(MENAGERIE, f"[{name}]", dict(read_toml(MENAGERIE)[name]))
    robot, file = str(table.take("robot", str)), str(table.values["model"])
    table.values.update(name=name, model=str(_folder(name, robot) / file))
    if not Path(table.values["model"]).exists():
        raise InputError(
            f"{table.values['model']}: there is no such file, which gripper {name!r} needs; is "
            f"{_ROOT} a checkout of MuJoCo Menagerie, and {robot} in it?"
        )
    return MjcfGripper.from_table(MENAGERIE, table)


def _folder(name: str, robot: str) -> Path:
    """Return the folder of a robot: of a checkout, or of the package, which may download it."""
    if root := os.environ.get(_ROOT):
        return Path(root) / robot
    try:
        import mujoco_menagerie
    except ImportError as error:
        raise InputError(
            f"gripper {name!r} is of MuJoCo Menagerie: {_INSTALL} (its one dependency, MuJoCo, is "
            f"installed), or let {_ROOT} name a checkout of "
            "https://github.com/google-deepmind/mujoco_menagerie"
        ) from error
    try:
        return Path(mujoco_menagerie.get(robot).path(progress=None))
    except (mujoco_menagerie.MenagerieError, OSError) as error:
        raise InputError(
            f"the model of gripper {name!r} is not at hand ({error}); where there is a network, "
            f"run: mujoco-menagerie prefetch {robot}, or let {_ROOT} name a checkout of MuJoCo "
            "Menagerie"
        ) from error
