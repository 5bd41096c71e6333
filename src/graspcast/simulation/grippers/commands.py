"""Commands of a hand in a TOML file: controls or keyframes as open and closed, and drives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from graspcast.errors import FormatError, UnknownNameError
from graspcast.io.toml import TomlTable
from graspcast.simulation.grippers.model_files import JointDrive, read_model
from graspcast.simulation.grippers.protocol import Closing
from graspcast.simulation.mujoco_messages import compile_spec

__all__ = ["check_commands", "read_controls", "read_drives"]


def read_controls(
    path: Path, model: Path, values: dict[str, Any], actuators: list[str]
) -> dict[str, Any]:
    """Return the table ``[closing]`` with controls where it names keyframes of the model.

    Parameters
    ----------
    path, model
        The TOML file, and the MJCF file.
    values
        The table.
    actuators
        Names of the actuators that count.

    Raises
    ------
    UnknownNameError
        If there is no such keyframe.
    FormatError
        If a control is not a number, or a keyframe does not say what the actuators' controls are.
    """
    read = dict(values)
    for key in ("open", "close"):
        given = values.get(key)
        if isinstance(given, str):
            controls = _of_keyframe(path, model, given)
            # Those of a floating base do not count.
            read[key] = {name: controls[name] for name in actuators if name in controls}
        elif key in values:
            inner = TomlTable(path, f"[closing] {key}", given)
            for actuator in inner.values:
                inner.number(actuator, lambda _: True, "a number")
    return read


def _of_keyframe(path: Path, model: Path, name: str) -> dict[str, float]:
    """Return the controls of all actuators at a keyframe of the model."""
    from graspcast.simulation.engine import mujoco

    spec = read_model(model)
    keys = {key.name: key for key in spec.keys}
    if name not in keys:
        raise UnknownNameError("keyframe", name, list(keys), hint=f"See {path} and {model}.")
    has_controls = len(list(keys[name].ctrl)) > 0
    compiled = compile_spec(spec, "it")
    data = mujoco.MjData(compiled)
    mujoco.mj_resetDataKeyframe(compiled, data, compiled.key(name).id)
    controls = data.ctrl
    if not has_controls:
        # Of a position servo, the control that holds it where the keyframe has it.
        gain, bias = compiled.actuator_gainprm[:, 0], compiled.actuator_biasprm
        if not ((gain > 0) & (bias[:, 1] < 0)).all():
            raise FormatError(
                model,
                f"its keyframe {name!r} has no ctrl, and not all actuators are position servos",
            )
        mujoco.mj_forward(compiled, data)
        controls = -(bias[:, 0] + bias[:, 1] * data.actuator_length) / gain
        low, high = compiled.actuator_ctrlrange.T
        limited = compiled.actuator_ctrllimited.astype(bool)
        controls = np.where(limited, np.clip(controls, low, high), controls)
    return {compiled.actuator(i).name: float(controls[i]) for i in range(compiled.nu)}


def read_drives(path: Path, values: dict[str, Any]) -> tuple[JointDrive, ...]:
    """Read the table ``[actuators]``: a position servo for each joint that is driven.

    Raises
    ------
    FormatError
        If a value is missing, or of the wrong kind or sign.
    """
    drives = []
    for name, given in values.items():
        table = TomlTable(path, f"[actuators] {name}", given)
        optional = {
            key: table.number(key, lambda x: x >= 0, "not negative")
            for key in ("force", "damping", "armature")
            if key in table.values
        }
        drives.append(
            JointDrive(
                name=name,
                joint=str(table.take("joint", str)),
                stiffness=table.number("stiffness", lambda x: x > 0, "above zero"),
                **optional,
            )
        )
        for key in optional:
            table.take(key, float)
        table.nothing_else()
    return tuple(drives)


def check_commands(
    path: Path, model: Path, compiled: Any, actuators: list[str], closing: Closing
) -> None:
    """Raise unless the closing command fits the actuators of the model.

    Raises
    ------
    UnknownNameError
        If it names one that is not there.
    FormatError
        If there are none, some have no name or no control, or a control is outside of its range,
        to which MuJoCo would clamp it.
    """
    if not actuators:
        raise FormatError(
            model,
            "has no actuator, so the hand cannot close; give it some, or describe drives of its "
            f"joints in [actuators] of {path.name}",
        )
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
