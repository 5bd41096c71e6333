"""Conformance suite for grippers, built-in or custom."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from graspcast.errors import GraspcastError
from graspcast.io.conformance import Check, Report, UnmetError
from graspcast.simulation.grippers.dimensions import size_problem
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.mujoco_messages import compile_spec
from graspcast.simulation.objects.types import (
    Grasp,
    GraspObject,
    Primitive,
    box_corners,
    check_rigid,
)
from graspcast.simulation.trial.scene import Scene
from graspcast.simulation.trial.settings import TrialSettings
from graspcast.simulation.trial.trial import Outcome, TrialRunner

__all__ = ["GripperReport", "check_gripper", "standing_column"]


_MUJOCO = {"timestep": 0.002, "impratio": 1.0}
"""MuJoCo's defaults, which a model without an option of its own has."""


class GripperReport(Report):
    """Result of :func:`check_gripper`."""

    kind = "gripper"


_DEEPEST_M = 0.003
_GRAVITY = 9.81
_MOSTLY, _CLEARLY, _ALIGNED_DEG = 0.8, 2.0, 30.0


def check_gripper(gripper: Gripper) -> GripperReport:
    """Run the conformance checks on a gripper; stop at a failure that later checks depend on.

    ========== ===============================================================
    check      requirement
    ========== ===============================================================
    describes  it has every member of the protocol
    compiles   its model compiles
    actuators  its commands name the actuators of its model
    touches    at least one of its geoms collides
    opens      it opens and comes to rest
    closes     it closes and comes to rest
    aligned    its fingers close along x of the TCP
    reopens    it opens again
    holds      it holds a column half as wide as its opening through the lift
    solid      it does not penetrate the column
    misses     it misses an object that is not there
    drops      it drops an object that is too heavy
    repeats    the same trial gives bitwise the same outcome
    ========== ===============================================================

    Parameters
    ----------
    gripper
        For example ``load_gripper("my_gripper.toml")``.
    """
    checks: list[Check] = []
    bench: dict[str, Any] = {}
    for name, check in _CHECKS:
        try:
            checks.append(Check(name, True, check(gripper, bench)))
        except (UnmetError, GraspcastError) as problem:
            checks.append(Check(name, False, str(problem)))
            if name in _NEEDED:
                break
    return GripperReport(str(getattr(gripper, "name", gripper)), tuple(checks))


def standing_column(width_m: float, *, mass_kg: float = 0.3, friction: float = 0.8) -> GraspObject:
    """Return a square column that stands on the table, three times as high as wide.

    Its origin is its centre.

    Parameters
    ----------
    width_m
        Side of the square, metres.
    mass_kg
        Mass.
    friction
        Coefficient of friction.
    """
    size = np.array([width_m, width_m, 3 * width_m])
    standing = np.eye(4)
    standing[2, 3] = size[2] / 2
    return GraspObject(
        name="test column",
        vertices=box_corners(size / 2),
        faces=np.zeros((0, 3), dtype=np.int64),
        pieces=(Primitive("box", (size[0] / 2, size[1] / 2, size[2] / 2), np.eye(4)),),
        mass_kg=mass_kg,
        friction=friction,
        centroid=np.zeros(3),
        inertia=np.diag(mass_kg / 12 * (np.sum(size**2) - size**2)),
        sim_T_ref=standing,
    )


def _describes(gripper: Gripper, bench: dict[str, Any]) -> str:
    wanted = [name for name in dir(Gripper) if not name.startswith("_")]
    if missing := [name for name in wanted if not hasattr(gripper, name)]:
        raise UnmetError(f"lacks {', '.join(missing)}")
    check_rigid(gripper.base_T_tcp, "base_T_tcp")
    if not gripper.max_opening_m > 0:
        raise UnmetError(f"max_opening_m is {gripper.max_opening_m}; it must be > 0")
    return f"opens to {1e3 * gripper.max_opening_m:.0f} mm"


def _compiles(gripper: Gripper, bench: dict[str, Any]) -> str:
    spec, other = gripper.spec(), gripper.spec()
    if spec is other:
        raise UnmetError("spec() returned the same object twice; it must return a new one")
    roots = list(spec.worldbody.bodies)
    if len(roots) != 1 or roots[0].joints:
        raise UnmetError(
            f"needs one root body, the hand's base, without a joint; it has {len(roots)}"
        )
    remarks: list[str] = []
    model = bench["model"] = compile_spec(spec, "its model", remarks)
    if problem := size_problem(model, gripper.max_opening_m):
        raise UnmetError(problem)
    parts = [f"{model.nv} degrees of freedom, {model.nu} actuators"]
    if remarks:
        parts.append(f"MuJoCo remarks: {' / '.join(remarks)}")
    settings = TrialSettings()
    own = {name: getattr(model.opt, name) for name in ("timestep", "impratio")}
    if any(own[name] not in (_MUJOCO[name], getattr(settings, name)) for name in own):
        parts.append(
            "its own option ("
            + ", ".join(f"{name} {value:g}" for name, value in own.items())
            + ") does not count in trials, which have theirs "
            f"({settings.timestep:g}, {settings.impratio:g})"
        )
    return "; ".join(parts)


def _actuators(gripper: Gripper, bench: dict[str, Any]) -> str:
    model, commanded = bench["model"], set(gripper.closing.open)
    there = {model.actuator(i).name for i in range(model.nu)}
    if commanded != there:
        if "" in there:
            raise UnmetError("an actuator of the model has no name; commands go by name")
        raise UnmetError(
            f"commands name {sorted(commanded)}, the model's actuators are {sorted(there)}"
        )
    return ", ".join(sorted(there))


def _touches(gripper: Gripper, bench: dict[str, Any]) -> str:
    model = bench["model"]
    count = int(np.count_nonzero(model.geom_contype | model.geom_conaffinity))
    if not count:
        raise UnmetError("no geom collides: give some a contype or conaffinity that is not zero")
    return f"{count} of {model.ngeom} geoms collide"


def _opens(gripper: Gripper, bench: dict[str, Any]) -> str:
    bench["width"] = 0.5 * gripper.max_opening_m
    bench["runner"] = TrialRunner(standing_column(bench["width"]), gripper)
    bench["hand"] = hand = _ParkedHand(bench["runner"].scene)
    hand.command(gripper.closing.open, 0.5)
    bench["open"], bench["open points"] = hand.scene.posture(), hand.scene.hand_points()
    speed = hand.scene.hand_speed()
    if speed > 1e-3:
        raise UnmetError(
            f"still moves at {1e3 * speed:.1f} mm/s, 1.5 s after the command to open: "
            "use more damping, or a weaker servo"
        )
    return "still when open"


def _closes(gripper: Gripper, bench: dict[str, Any]) -> str:
    hand, closing = bench["hand"], gripper.closing
    hand.ramp(closing.open, closing.close, closing.seconds)
    hand.command(closing.close, gripper.equilibrium.limit_s)
    moved = float(np.abs(hand.scene.posture() - bench["open"]).max())
    bench["closed points"] = hand.scene.hand_points()
    if moved < 0.1 * gripper.max_opening_m:
        raise UnmetError(
            f"no joint moved by more than {1e3 * moved:.1f} mm on its way from open to closed; "
            "are open and close different, and the servo strong enough?"
        )
    if hand.scene.hand_speed() > 1e-3:
        raise UnmetError(
            f"closed without an object, it still moves at {1e3 * hand.scene.hand_speed():.1f} mm/s "
            f"after {gripper.equilibrium.limit_s:g} s"
        )
    return f"moves a joint by {1e3 * moved:.0f} mm and comes to rest"


def _aligned(gripper: Gripper, bench: dict[str, Any]) -> str:
    if "closed points" not in bench:
        raise UnmetError("unknown, as the hand was not seen closed")
    # In the TCP's frame: how much the parts of the hand move along each axis, and between them.
    motion = (bench["closed points"] - bench["open points"]) @ gripper.base_T_tcp[:3, :3]
    spread = motion.T @ motion
    share = np.diag(spread) / max(float(np.trace(spread)), 1e-12)
    direction = f"{share[0]:.0%} of their motion is along x of the TCP, {share[1]:.0%} along y"
    if share[2] > _MOSTLY and share[0] < 1 - _MOSTLY:
        raise UnmetError(
            "from open to closed the fingers move along z of the TCP, not along x; z is the "
            "direction out along the fingers, x that in which they close: turn the TCP's frame"
        )
    low, high = np.linalg.eigvalsh(spread[:2, :2])
    angle = 0.5 * np.degrees(np.arctan2(2 * spread[0, 1], spread[0, 0] - spread[1, 1]))
    if high > _CLEARLY * low and abs(angle) > _ALIGNED_DEG:
        axis = "along y" if abs(angle) > 90 - _ALIGNED_DEG else f"at {abs(angle):.0f}° to x"
        raise UnmetError(
            f"from open to closed the fingers move {axis} of the TCP, not along x: reference "
            f"grasps would be tried turned by {abs(angle):.0f}°; turn the TCP's frame about its z"
        )
    return f"the fingers close along x of the TCP ({direction})"


def _reopens(gripper: Gripper, bench: dict[str, Any]) -> str:
    hand, closing = bench["hand"], gripper.closing
    hand.ramp(closing.close, closing.open, closing.seconds)
    hand.command(closing.open, 1.0)
    difference = float(np.abs(hand.scene.posture() - bench["open"]).max())
    if difference > 1e-3:
        raise UnmetError(f"a joint is {1e3 * difference:.1f} mm from its open position")
    return f"back to open within {1e3 * difference:.2f} mm"


def _grasp(gripper: Gripper, width: float, raised_m: float = 0.0) -> Grasp:
    # From above, the TCP half a width below the column's top.
    obj_T_grasp = np.diag([1.0, -1.0, -1.0, 1.0])
    obj_T_grasp[2, 3] = width + raised_m
    return Grasp(obj_T_grasp, "test column", gripper.name)


def _holds(gripper: Gripper, bench: dict[str, Any]) -> str:
    width, runner = bench["width"], bench["runner"]
    depths, pressed = [0.0], [0.0]

    def watch(model: Any, data: Any, phase: str) -> None:
        depths.append(runner.scene.hand_overlap_m())
        if phase == "close":
            pressed.append(runner.scene.grip_n())

    outcome = runner.run(np.eye(4), _grasp(gripper, width), early_stop=False, record=watch)
    bench["held"], bench["depth"] = outcome, max(depths)
    column = runner.grasp_object
    needed = column.mass_kg * _GRAVITY / (2 * column.friction)
    press = f"the fingers press with {pressed[-1]:.1f} N a side"
    if outcome.success:
        return (
            f"a column of {1e3 * width:.0f} mm moved by {1e3 * outcome.offset_m:.1f} mm in the "
            f"hand; {press}"
        )
    if outcome.stop:
        raise UnmetError(
            f"the hand {outcome.stop}, on the way to a column of {1e3 * width:.0f} mm: does it "
            "open when told to, and is the TCP between the fingertips, its z out along the fingers?"
        )
    what = (
        f"a column of {1e3 * width:.0f} mm and {column.mass_kg:g} kg, grasped without error, was "
        f"{outcome.reason} (offset {1e3 * outcome.offset_m:.0f} mm)"
    )
    if 0 < pressed[-1] < needed:
        raise UnmetError(
            f"{what}: {press}, and {needed:.1f} N are needed at a friction of "
            f"{column.friction:g}; give the actuators more force (gain, forcerange)"
        )
    raise UnmetError(
        f"{what}; {press if pressed[-1] else 'the fingers do not press on it'}. Is the TCP between "
        "the fingertips, its z out along the fingers, its x the direction of closing?"
    )


def _solid(gripper: Gripper, bench: dict[str, Any]) -> str:
    depth = bench["depth"]
    if depth > _DEEPEST_M:
        raise UnmetError(
            f"it penetrated the grasped column by {1e3 * depth:.1f} mm, so it could pass "
            "through a thin wall: limit its actuators' force, or give its joints more armature"
        )
    return f"at most {1e3 * depth:.2f} mm deep in the column"


def _misses(gripper: Gripper, bench: dict[str, Any]) -> str:
    runner: TrialRunner = bench["runner"]
    raised = 0.5 * bench["width"] + gripper.max_opening_m
    outcome = runner.run(np.eye(4), _grasp(gripper, bench["width"], raised), early_stop=False)
    if outcome.reason != "missed":
        raise UnmetError(f"grasping {1e3 * raised:.0f} mm too high was {outcome.reason}")
    return f"grasping {1e3 * raised:.0f} mm too high leaves the column standing"


def _drops(gripper: Gripper, bench: dict[str, Any]) -> str:
    width = bench["width"]
    heavy = TrialRunner(standing_column(width, mass_kg=100.0), gripper)
    outcome = heavy.run(np.eye(4), _grasp(gripper, width))
    if outcome.reason not in ("dropped", "slipped", "missed"):
        raise UnmetError(
            f"a column of 100 kg was {outcome.reason}: is any actuator without a force limit?"
        )
    return f"a column of 100 kg is {outcome.reason}"


def _repeats(gripper: Gripper, bench: dict[str, Any]) -> str:
    runner: TrialRunner = bench["runner"]
    again = runner.run(np.eye(4), _grasp(gripper, bench["width"]), early_stop=False)
    fresh = TrialRunner(standing_column(bench["width"]), gripper)
    anew = fresh.run(np.eye(4), _grasp(gripper, bench["width"]), early_stop=False)
    if not _same(again, bench["held"]) or not _same(anew, bench["held"]):
        raise UnmetError(
            f"the same trial gave offsets of {bench['held'].offset_m!r}, {again.offset_m!r} and "
            f"{anew.offset_m!r} m; does spec() depend on anything that changes?"
        )
    return "the same trial gives bitwise the same outcome"


def _same(one: Outcome, other: Outcome) -> bool:
    return replace(one, computed_s=0.0) == replace(other, computed_s=0.0)


_CHECKS: tuple[tuple[str, Callable[[Gripper, dict[str, Any]], str]], ...] = (
    ("describes", _describes),
    ("compiles", _compiles),
    ("actuators", _actuators),
    ("touches", _touches),
    ("opens", _opens),
    ("closes", _closes),
    ("aligned", _aligned),
    ("reopens", _reopens),
    ("holds", _holds),
    ("solid", _solid),
    ("misses", _misses),
    ("drops", _drops),
    ("repeats", _repeats),
)
_NEEDED = ("describes", "compiles", "actuators", "touches", "opens")


class _ParkedHand:
    """Hand of a scene, high above object and table."""

    def __init__(self, scene: Scene):
        self.scene = scene
        scene.park()

    def command(self, controls: Mapping[str, float], seconds: float) -> None:
        scene = self.scene
        for name, value in controls.items():
            scene.data.ctrl[scene.hand_ctrl[name]] = value
        mujoco.mj_step(scene.model, scene.data, nstep=round(seconds / scene.settings.timestep))

    def ramp(self, start: Mapping[str, float], end: Mapping[str, float], seconds: float) -> None:
        count = max(1, round(seconds / 0.01))
        for k in range(1, count + 1):
            self.command({n: start[n] + k / count * (end[n] - start[n]) for n in start}, 0.01)
