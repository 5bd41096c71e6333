"""Model files of hands, MJCF or URDF, read into MuJoCo specifications with one fixed base."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from graspcast.errors import FormatError, InputError, UnknownNameError
from graspcast.io.reading import MAX_TEXT_BYTES, check_regular, read_bytes
from graspcast.simulation.grippers.urdf import read_urdf
from graspcast.simulation.mujoco_messages import compile_spec, one_line, quiet_mujoco

__all__ = ["JointDrive", "compile_hand", "fixed_base", "load_model", "read_model"]


@dataclass(frozen=True)
class JointDrive:
    """Position servo on a joint, for a model without actuators.

    Attributes
    ----------
    name
        The actuator's name.
    joint
        The joint's name.
    stiffness
        Stiffness, N/m or Nm/rad.
    force
        Largest force or torque, N or Nm; by default the joint's effort limit.
    damping
        Damping of the servo, N s/m or Nm s/rad.
    armature
        Inertia of the drive at the joint, kg or kg m²; by default the model's.
    """

    name: str
    joint: str
    stiffness: float
    force: float | None = None
    damping: float = 0.0
    armature: float | None = None


def load_model(path: Path, drives: Sequence[JointDrive] = ()) -> Any:
    """Read a hand's model: its base fixed, and with the given drives.

    Raises
    ------
    InputError
        If there is no such file.
    FormatError
        If MuJoCo does not read it, its base is not one body, or it has actuators besides drives.
    UnknownNameError
        If a drive's joint is not in the model.
    """
    spec = read_model(path)
    fixed_base(spec, path)
    if drives and list(spec.actuators):
        names = ", ".join(a.name or "one without a name" for a in spec.actuators)
        raise FormatError(path, f"has actuators ({names}), so it needs no [actuators] in the TOML")
    for drive in drives:
        _add_drive(spec, path, drive)
    return spec


def read_model(path: Path) -> Any:
    """Read an MJCF file, or a URDF by its suffix, as it is.

    Raises
    ------
    InputError
        If there is no such file.
    FormatError
        If MuJoCo does not read it.
    """
    from graspcast.simulation.engine import mujoco

    if not path.exists():
        raise InputError(f"{path}: there is no such file; the TOML's key 'model' names it")
    if path.suffix.lower() == ".urdf":
        return read_urdf(path)
    _check_files(path)
    quiet_mujoco()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return mujoco.MjSpec.from_file(str(path))
    except (ValueError, TypeError, RuntimeError) as error:  # also of bytes that are not UTF-8
        raise FormatError(path, f"is not MJCF that MuJoCo reads: {one_line(error)}") from error


def fixed_base(spec: Any, path: Path) -> str:
    """Fix a hand's base to the world, since the arm carries it.

    Joints of the only root body, on which a hand floats on its own, are removed, with the
    actuators, tendons, equalities, sensors and keyframes that name them.

    Returns
    -------
        A remark on what was removed; empty if nothing was.

    Raises
    ------
    FormatError
        If the model has no root body or several.
    """
    roots = list(spec.worldbody.bodies)
    if len(roots) != 1:
        found = ", ".join(f"{b.name!r}{' (with a joint)' if b.joints else ''}" for b in roots)
        raise FormatError(
            path, f"must have one root body, the hand's base; it has {found or 'none'}"
        )
    joints = list(roots[0].joints)
    if not joints:
        return ""
    if len(joints) == len(list(spec.joints)):
        raise FormatError(
            path,
            f"has no joint but {len(joints)} of its root body {roots[0].name!r}, which is the "
            "hand's base: put the moving fingers into bodies of their own inside it",
        )
    names = {joint.name for joint in joints} - {""}
    removed = [a.name for a in spec.actuators if a.target in names]
    for tendon in list(spec.tendons):
        if any(getattr(wrap.target, "name", None) in names for wrap in tendon.path):
            raise FormatError(path, f"its tendon {tendon.name!r} moves the hand's base: remove it")
    for element in [
        *(a for a in spec.actuators if a.target in names),
        *(e for e in spec.equalities if {e.name1, e.name2} & names),
        *(s for s in spec.sensors if s.objname in names),
        *spec.keys,
        *joints,
    ]:
        spec.delete(element)
    said = f"the arm carries the base {roots[0].name!r}, so its {len(joints)} joint(s) do not count"
    return said + (f", nor the actuators {', '.join(removed)}" if removed else "")


def compile_hand(spec: Any, path: Path) -> Any:
    """Compile a hand's model.

    Raises
    ------
    FormatError
        If MuJoCo does not compile it, or none of its parts collides.
    """
    try:
        compiled = compile_spec(spec, "it")
    except InputError as error:
        raise FormatError(path, str(error)) from error
    hand = compiled.geom_bodyid != 0
    if not np.any((compiled.geom_contype | compiled.geom_conaffinity)[hand]):
        raise FormatError(
            path,
            f"no geom of the hand collides ({int(hand.sum())} are there, all to be seen only), so "
            "it cannot touch anything: give it collision geometry"
            + (" (<collision>)" if path.suffix.lower() == ".urdf" else " (contype, conaffinity)"),
        )
    return compiled


def _add_drive(spec: Any, path: Path, drive: JointDrive) -> None:
    from graspcast.simulation.engine import mujoco

    joints = {joint.name: joint for joint in spec.joints}
    if drive.joint not in joints:
        raise UnknownNameError("joint", drive.joint, list(joints), hint=f"See {path}.")
    joint = joints[drive.joint]
    effort = float(max(np.abs(joint.actfrcrange)))
    force = drive.force if drive.force is not None else effort
    if not force > 0:
        raise FormatError(
            path,
            f"states no effort limit of the joint {drive.joint!r}: give the actuator's 'force'",
        )
    if drive.armature is not None:
        joint.armature = drive.armature
    servo = spec.add_actuator(
        name=drive.name,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        target=drive.joint,
        forcelimited=True,
        forcerange=(-force, force),
    )
    servo.set_to_position(kp=drive.stiffness, kv=drive.damping)


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
