"""Custom gripper from an MJCF model and a TOML file that describes its use.

::

    name = "three_jaw"
    model = "three_jaw.xml"        # beside the TOML; its only root body is the base, without joint
    max_opening_m = 0.09
    self_collision = false         # optional
    tcp_site = "tcp"               # z: out along the fingers; x: the direction of closing

    [closing]
    seconds = 0.8
    open = { drive = 0.0 }         # an entry for each actuator of the model
    close = { drive = 0.04 }

    [equilibrium]                  # optional, see grippers.protocol.Equilibrium
    limit_s = 3.0

    [approach]                     # optional, see grippers.protocol.ApproachLimits
    force_n = 25.0
    short_m = 0.003
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import FormatError, InputError, UnknownNameError
from graspcast.io.reading import MAX_TEXT_BYTES, check_regular, read_bytes
from graspcast.io.toml import TomlTable, read_toml
from graspcast.pose.transforms import transform
from graspcast.simulation.grippers.dimensions import size_problem
from graspcast.simulation.grippers.protocol import ApproachLimits, Closing, Equilibrium
from graspcast.simulation.mujoco_messages import compile_spec, one_line, quiet_mujoco

__all__ = ["MjcfGripper"]


@dataclass(frozen=True, eq=False)
class MjcfGripper:
    """Gripper from an MJCF file; the module's docstring describes the TOML file."""

    name: str
    model: Path
    base_T_tcp: Float[ndarray, "4 4"]
    max_opening_m: float
    closing: Closing
    equilibrium: Equilibrium
    self_collision: bool
    approach: ApproachLimits = field(default_factory=ApproachLimits)

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
            return cls._from_table(path, table)
        except UnicodeDecodeError as error:  # MuJoCo gives names as they are in the file
            where = path.parent / str(table.values.get("model"))
            raise FormatError(where, "has a name that is not UTF-8") from error

    @classmethod
    def _from_table(cls, path: Path, table: TomlTable) -> MjcfGripper:
        model = path.parent / str(table.take("model", str))
        spec = _load(model)
        compiled = _compile(spec, model)
        closing = _section(path, "closing", Closing, table.take("closing", dict))
        _check_actuators(path, model, [a.name for a in spec.actuators], closing)
        _check_commands(path, compiled, closing)
        equilibrium = table.take("equilibrium", dict, {})
        approach = table.take("approach", dict, {})
        name = str(table.take("name", str))
        if not name.strip():
            raise table.error("name", "is empty; outcomes and grasps refer to the gripper by it")
        gripper = cls(
            name=name,
            model=model,
            base_T_tcp=_tcp(path, compiled, table.take("tcp_site", str)),
            max_opening_m=table.number("max_opening_m", lambda x: x > 0, "above zero"),
            closing=closing,
            equilibrium=_section(path, "equilibrium", Equilibrium, equilibrium),
            self_collision=table.take("self_collision", bool, False),
            approach=_section(path, "approach", ApproachLimits, approach),
        )
        table.nothing_else()
        if problem := size_problem(compiled, gripper.max_opening_m):
            raise FormatError(path, problem)
        return gripper

    def spec(self) -> Any:
        """Read the MJCF file."""
        return _load(self.model)


def _check_actuators(path: Path, model: Path, actuators: list[str], closing: Closing) -> None:
    """Raise unless the closing command names exactly the actuators of the model."""
    if not actuators:
        raise FormatError(model, "has no actuator, so the hand cannot close")
    if unnamed := actuators.count(""):
        raise FormatError(
            model,
            f"{unnamed} of its {len(actuators)} actuators have no name; give each a name=..., by "
            f"which [closing] in {path.name} sets its control",
        )
    for name in closing.open:
        if name not in actuators:
            raise UnknownNameError("actuator", name, actuators, hint=f"See {path} and {model}.")
    if missing := [name for name in actuators if name not in closing.open]:
        raise FormatError(
            path,
            f"lacks the actuators {', '.join(missing)} of {model.name}: give the control of each "
            "when open and when closed",
            where="[closing]",
        )


def _check_commands(path: Path, compiled: Any, closing: Closing) -> None:
    """Raise if a control lies outside of its actuator's range, to which MuJoCo would clamp it."""
    for which, controls in (("open", closing.open), ("close", closing.close)):
        for name, value in controls.items():
            actuator = compiled.actuator(name)
            low, high = map(float, actuator.ctrlrange)
            slack = 1e-6 + 1e-3 * (high - low)
            if actuator.ctrllimited[0] and not low - slack <= value <= high + slack:
                raise FormatError(
                    path,
                    f"{which} sets {name} to {value:g}, outside of its ctrlrange {low:g} to "
                    f"{high:g}; controls are in the actuator's own unit, of a slide metres",
                    where="[closing]",
                )


def _section(path: Path, name: str, kind: type[Any], values: dict[str, Any]) -> Any:
    table = TomlTable(path, f"[{name}]", values)
    for key, value in values.items():
        # The wrong type of a known key; unknown keys are an error below.
        if key in ("open", "close"):
            inner = TomlTable(path, f"[{name}] {key}", value)
            for actuator in inner.values:
                inner.number(actuator, lambda _: True, "a number")
        elif key in kind.__dataclass_fields__:
            table.number(key, lambda _: True, "a number")
    try:
        return kind(**values)
    except TypeError as error:
        known = ", ".join(kind.__dataclass_fields__)
        raise FormatError(path, f"{error}; it may hold {known}", where=f"[{name}]") from error
    except InputError as error:
        raise FormatError(path, str(error), where=f"[{name}]") from error


def _load(model: Path) -> Any:
    import mujoco

    if not model.exists():
        raise InputError(f"{model}: there is no such file; the TOML's key 'model' names it")
    _check_files(model)
    quiet_mujoco()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return mujoco.MjSpec.from_file(str(model))
    except (ValueError, TypeError, RuntimeError) as error:  # also of bytes that are not UTF-8
        raise FormatError(model, f"is not MJCF that MuJoCo reads: {one_line(error)}") from error


_FILE = re.compile(r"""\bfile\s*=\s*["']([^"']+)""")


def _check_files(model: Path) -> None:
    """Raise unless an MJCF file, and what it includes, are regular files; MuJoCo opens any."""
    waiting, seen = [model], set()
    while waiting:
        path = waiting.pop()
        if path in seen:
            continue
        seen.add(path)
        if path.suffix.lower() != ".xml" and path != model:
            check_regular(path)
            continue
        named = _FILE.findall(read_bytes(path, MAX_TEXT_BYTES).decode(errors="replace"))
        near = (model.parent / name for name in named)
        waiting += [file for file in near if file.exists()]  # MuJoCo tells of missing ones


def _compile(spec: Any, model: Path) -> Any:
    roots = list(spec.worldbody.bodies)
    if len(roots) != 1 or roots[0].joints:
        found = ", ".join(f"{b.name!r}{' (with a joint)' if b.joints else ''}" for b in roots)
        raise FormatError(
            model, f"must have one root body, the hand's base, without a joint; it has {found}"
        )
    try:
        return compile_spec(spec, "it")
    except InputError as error:
        raise FormatError(model, str(error)) from error


def _tcp(path: Path, compiled: Any, site: str) -> Float[ndarray, "4 4"]:
    import mujoco

    names = [compiled.site(i).name for i in range(compiled.nsite)]
    if site not in names:
        raise UnknownNameError("site", site, names, hint=f"{path} names it as tcp_site.")
    data = mujoco.MjData(compiled)
    mujoco.mj_kinematics(compiled, data)
    # The root body is body 1; the world is 0.
    base = data.xmat[1].reshape(3, 3)
    rotation = base.T @ data.site(site).xmat.reshape(3, 3)
    return transform(rotation, base.T @ (data.site(site).xpos - data.xpos[1]))
