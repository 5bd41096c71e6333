"""A user's own gripper: an MJCF model and a short TOML that says how to use it.

::

    name = "three_jaw"
    model = "three_jaw.xml"        # beside the TOML; one root body, the hand's base, without joint
    max_opening_m = 0.09
    self_collision = false         # optional
    tcp_site = "tcp"               # z: out along the fingers; x: the direction of closing

    [closing]
    seconds = 0.8
    open = { drive = 0.0 }         # one entry for each actuator of the model
    close = { drive = 0.04 }

    [equilibrium]                  # optional, see grippers.protocol.Equilibrium
    limit_s = 3.0
"""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import FormatError, InputError, UnknownNameError
from graspcast.io.toml import read_toml
from graspcast.pose.transforms import transform
from graspcast.simulation.grippers.protocol import Closing, Equilibrium

__all__ = ["MjcfGripper"]

_KEYS = ("name", "model", "max_opening_m", "self_collision", "tcp_site", "closing", "equilibrium")
_OPTIONAL = ("self_collision", "equilibrium")


@dataclass(frozen=True, eq=False)
class MjcfGripper:
    """A gripper from an MJCF file; see the module's docstring for the TOML that describes it."""

    name: str
    model: Path
    base_T_tcp: Float[ndarray, "4 4"]
    max_opening_m: float
    closing: Closing
    equilibrium: Equilibrium
    self_collision: bool

    @classmethod
    def from_toml(cls, path: str | PathLike[str]) -> MjcfGripper:
        """Read the TOML and check it against its MJCF.

        Raises
        ------
        InputError
            If a file cannot be read.
        FormatError
            If the TOML lacks or misspells a key, or MuJoCo cannot compile the MJCF, or the MJCF has
            not exactly one fixed root body.
        UnknownNameError
            If an actuator or the site is not in the MJCF.
        """
        path = Path(path)
        table = _read(path)
        model = path.parent / str(table["model"])
        spec = _load(model)
        compiled = _compile(spec, model)
        closing = _section(path, "closing", Closing, table["closing"])
        actuators = [a.name for a in spec.actuators]
        for name in closing.open:
            if name not in actuators:
                raise UnknownNameError("actuator", name, actuators, hint=f"See {path} and {model}.")
        if missing := [name for name in actuators if name not in closing.open]:
            raise FormatError(
                path,
                f"{model.name} has the actuators {', '.join(actuators)}, but nothing is said of "
                f"{', '.join(missing)}: give each its control when open and when closed",
                where="[closing]",
            )
        return cls(
            name=str(table["name"]),
            model=model,
            base_T_tcp=_tcp(path, compiled, str(table["tcp_site"])),
            max_opening_m=_positive(path, "max_opening_m", table["max_opening_m"]),
            closing=closing,
            equilibrium=_section(path, "equilibrium", Equilibrium, table.get("equilibrium", {})),
            self_collision=bool(table.get("self_collision", False)),
        )

    def spec(self) -> Any:
        """The MJCF, read afresh."""
        return _load(self.model)


def _read(path: Path) -> dict[str, Any]:
    table = read_toml(path)
    for key in table:
        if key not in _KEYS:
            raise UnknownNameError("key", key, _KEYS, hint=f"It is in {path}.")
    if missing := [key for key in _KEYS if key not in table and key not in _OPTIONAL]:
        raise FormatError(path, f"lacks {', '.join(missing)}; a gripper needs them all")
    return table


def _section(path: Path, name: str, kind: type[Any], values: Any) -> Any:
    if not isinstance(values, dict):
        raise FormatError(path, "must be a table", where=f"[{name}]")
    try:
        return kind(**values)
    except TypeError as error:
        known = ", ".join(kind.__dataclass_fields__)
        raise FormatError(path, f"{error}; it may hold {known}", where=f"[{name}]") from error
    except InputError as error:
        raise FormatError(path, str(error), where=f"[{name}]") from error


def _positive(path: Path, key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
        raise FormatError(path, f"must be a number above zero, got {value!r}", where=key)
    return float(value)


def _load(model: Path) -> Any:
    import mujoco

    if not model.is_file():
        raise InputError(f"{model}: there is no such file; the TOML's key 'model' names it")
    try:
        return mujoco.MjSpec.from_file(str(model))
    except ValueError as error:
        raise FormatError(model, f"is not MJCF that MuJoCo reads: {error}") from error


def _compile(spec: Any, model: Path) -> Any:
    roots = list(spec.worldbody.bodies)
    if len(roots) != 1 or roots[0].joints:
        found = ", ".join(f"{b.name!r}{' (with a joint)' if b.joints else ''}" for b in roots)
        raise FormatError(
            model, f"must have one root body, the hand's base, without a joint; it has {found}"
        )
    try:
        return spec.compile()
    except ValueError as error:
        raise FormatError(model, f"does not compile: {error}") from error


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
