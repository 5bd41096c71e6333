"""Custom gripper from an MJCF or URDF model and a TOML file that describes its use.

::

    name = "three_jaw"
    model = "three_jaw.xml"        # beside the TOML; its only root body is the base
    max_opening_m = 0.09
    self_collision = false         # optional
    tcp_site = "tcp"               # z: out along the fingers; x: the direction of closing

    # In place of a site, a pose:
    # tcp_position_m = [0.0, 0.0, 0.12]
    # tcp_quaternion = [1.0, 0.0, 0.0, 0.0]   # wxyz
    # tcp_body = "palm"            # optional, in whose frame; by default the base's

    [closing]
    seconds = 0.8
    open = { drive = 0.0 }         # an entry for each actuator, or the name of a keyframe
    close = { drive = 0.04 }

    [equilibrium]                  # optional, see grippers.protocol.Equilibrium
    limit_s = 3.0

    [approach]                     # optional, see grippers.protocol.ApproachLimits
    force_n = 25.0
    short_m = 0.003
    [actuators.drive]              # of a model without actuators, such as a URDF
    joint = "left_finger_joint"
    stiffness = 3000.0             # N/m, or Nm/rad
    force = 40.0                   # optional: N or Nm; by default the joint's effort limit
    damping = 60.0                 # optional
    armature = 0.1                 # optional: kg or kg m^2
"""

from __future__ import annotations

from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import FormatError, InputError
from graspcast.io.toml import TomlTable, read_toml
from graspcast.simulation.grippers.commands import check_commands, read_controls, read_drives
from graspcast.simulation.grippers.dimensions import size_problem
from graspcast.simulation.grippers.model_files import (
    JointDrive,
    compile_hand,
    fixed_base,
    load_model,
    read_model,
)
from graspcast.simulation.grippers.protocol import ApproachLimits, Closing, Equilibrium
from graspcast.simulation.grippers.tool_centre import read_tcp

__all__ = ["MjcfGripper"]


@dataclass(frozen=True, eq=False)
class MjcfGripper:
    """Gripper from an MJCF or URDF file; the module's docstring describes the TOML file.

    Attributes
    ----------
    notes
        What of the model does not count.
    """

    name: str
    model: Path
    base_T_tcp: Float[ndarray, "4 4"]
    max_opening_m: float
    closing: Closing
    equilibrium: Equilibrium
    self_collision: bool
    approach: ApproachLimits = field(default_factory=ApproachLimits)
    drives: tuple[JointDrive, ...] = ()
    notes: tuple[str, ...] = ()

    @classmethod
    def from_toml(cls, path: str | PathLike[str]) -> MjcfGripper:
        """Read the TOML and check it against its MJCF.

        Raises
        ------
        InputError
            If the MJCF file does not exist.
        FormatError
            If the TOML file is not valid or does not fit the hand, MuJoCo cannot compile the MJCF,
            or the MJCF does not have exactly one root body without joint, and names of actuators.
        UnknownNameError
            If the MJCF lacks an actuator or the site.
        """
        path = Path(path)
        table = TomlTable(path, "the gripper", read_toml(path))
        try:
            return cls.from_table(path, table)
        except UnicodeDecodeError as error:  # MuJoCo gives names as they are in the file
            where = path.parent / str(table.values.get("model"))
            raise FormatError(where, "has a name that is not UTF-8") from error

    @classmethod
    def from_table(cls, path: Path, table: TomlTable) -> MjcfGripper:
        """Read a gripper from a table of a TOML file, with the errors of :meth:`from_toml`."""
        model = path.parent / str(table.take("model", str))
        drives = read_drives(path, table.take("actuators", dict, {}))
        note = fixed_base(read_model(model), model)
        spec = load_model(model, drives)
        compiled = compile_hand(spec, model)
        names = [actuator.name for actuator in spec.actuators]
        commands = read_controls(path, model, table.take("closing", dict), names)
        closing = _section(path, "closing", Closing, commands)
        check_commands(path, model, compiled, names, closing)
        equilibrium = table.take("equilibrium", dict, {})
        approach = table.take("approach", dict, {})
        name = str(table.take("name", str))
        if not name.strip():
            raise table.error("name", "is empty; outcomes and grasps refer to the gripper by it")
        gripper = cls(
            name=name,
            model=model,
            base_T_tcp=read_tcp(path, table, compiled),
            max_opening_m=table.number("max_opening_m", lambda x: x > 0, "above zero"),
            closing=closing,
            equilibrium=_section(path, "equilibrium", Equilibrium, equilibrium),
            self_collision=table.take("self_collision", bool, False),
            approach=_section(path, "approach", ApproachLimits, approach),
            drives=drives,
            notes=(note,) if note else (),
        )
        table.nothing_else()
        if problem := size_problem(compiled, gripper.max_opening_m):
            raise FormatError(path, problem)
        return gripper

    def spec(self) -> Any:
        """Read the model file."""
        return load_model(self.model, self.drives)


def _section(path: Path, name: str, kind: type[Any], values: dict[str, Any]) -> Any:
    table = TomlTable(path, f"[{name}]", values)
    for key in values:
        # The wrong type of a known key; unknown keys are an error below.
        if key in kind.__dataclass_fields__ and key not in ("open", "close"):
            table.number(key, lambda _: True, "a number")
    try:
        return kind(**values)
    except TypeError as error:
        known = ", ".join(kind.__dataclass_fields__)
        raise FormatError(path, f"{error}; it may hold {known}", where=f"[{name}]") from error
    except InputError as error:
        raise FormatError(path, str(error), where=f"[{name}]") from error
