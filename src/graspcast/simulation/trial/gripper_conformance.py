"""Conformance suite for grippers, built-in or custom."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from graspcast.errors import GraspcastError
from graspcast.io.conformance import Check, Report, UnmetError
from graspcast.simulation.grippers.dimensions import size_problem
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.mujoco_messages import compile_spec
from graspcast.simulation.objects.types import GraspObject, check_rigid
from graspcast.simulation.trial.gripper_bench import ParkedHand, grasp_of_column, standing_column
from graspcast.simulation.trial.gripper_measurement import (
    Corrected,
    GripperMeasurement,
    measure_closing,
)
from graspcast.simulation.trial.gripper_tcp import check_aligned, check_centred, check_opening
from graspcast.simulation.trial.scene_spec import scene_spec
from graspcast.simulation.trial.settings import TrialSettings
from graspcast.simulation.trial.trial import Outcome, TrialRunner

__all__ = ["GripperReport", "check_gripper"]


_MUJOCO = {"timestep": 0.002, "impratio": 1.0}
"""MuJoCo's defaults, which a model without an option of its own has."""


@dataclass(frozen=True)
class GripperReport(Report):
    """Result of :func:`check_gripper`.

    Attributes
    ----------
    measured
        What the gripper does in simulation; None if its fingers were not seen to close.
    notes
        Remarks of MuJoCo on the model, which do no harm.
    """

    kind = "gripper"

    measured: GripperMeasurement | None = None
    notes: tuple[str, ...] = ()


_DEEPEST_M = 0.003
_GRAVITY = 9.81
_WEAK = 1.5
"""Below how many times the force that holds an object at rest a grip is weak, if it drops it."""
_DEEP = 2.5
"""Depth of the test column in its widths; the hand opens to two of them."""


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
    opening    it opens about as wide as it states
    aligned    its fingers close along x of the TCP, and its z points out of the hand
    centred    its TCP is between the fingers
    reopens    it opens again
    holds      it holds a column half as wide as its opening, and deeper than it, through the lift
    solid      it does not penetrate the column
    misses     it misses an object that is not there
    drops      it drops an object that is too heavy
    repeats    the same trial gives bitwise the same outcome
    ========== ===============================================================

    Where the fingers close and how hard they press is measured, whatever the gripper states. If its
    TCP is not where they meet, it grasps with the measured one, so that the remaining checks tell
    of the hand.

    Parameters
    ----------
    gripper
        For example ``load_gripper("my_gripper.toml")``.
    """
    checks: list[Check] = []
    bench: dict[str, Any] = {"grasper": gripper, "notes": list(getattr(gripper, "notes", ()))}
    for name, check in _CHECKS:
        try:
            checks.append(Check(name, True, check(gripper, bench)))
        except (UnmetError, GraspcastError) as problem:
            checks.append(Check(name, False, str(problem)))
            if name in _NEEDED or bench.get("hopeless"):
                break
    measured = bench.get("measured")
    if measured is not None:
        measured = measured.with_grip(bench.get("pressed", float("nan")))
    name = str(getattr(gripper, "name", gripper))
    return GripperReport(name, tuple(checks), measured, tuple(bench["notes"]))


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
    settings = TrialSettings()
    # What MuJoCo says of the hand alone, and of the hand on an arm.
    attached = scene_spec(standing_column(0.5 * gripper.max_opening_m), gripper, settings)
    compile_spec(attached, "the hand on an arm", remarks)
    bench["notes"] += [f"MuJoCo: {remark}" for remark in dict.fromkeys(remarks)]
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
    bench["hand"] = hand = ParkedHand(bench["runner"].scene)
    hand.command(gripper.closing.open, 0.5)
    bench["open"] = hand.scene.posture()
    speed = hand.scene.hand_speed()
    if speed > 1e-3:
        raise UnmetError(
            f"still moves at {1e3 * speed:.1f} mm/s, 1.5 s after the command to open: "
            "use more damping, or a weaker servo"
        )
    return "still when open"


def _closes(gripper: Gripper, bench: dict[str, Any]) -> str:
    hand, closing = bench["hand"], gripper.closing
    postures = hand.close(closing, gripper.equilibrium.limit_s)
    bench["hopeless"] = True  # of a hand that is unstable or closes outwards the rest says nothing
    if hand.scene.diverged():
        raise UnmetError(
            "the simulation of the closing hand is unstable: use more damping and armature, or a "
            "weaker servo"
        )
    moved = float(np.abs(hand.scene.posture() - bench["open"]).max())
    speed = hand.scene.hand_speed()
    if moved < 0.1 * gripper.max_opening_m:
        bench["hopeless"] = False
        raise UnmetError(
            f"no joint moved by more than {1e3 * moved:.1f} mm on its way from open to closed; "
            "are open and close different, and the servo strong enough?"
        )
    bench["measured"] = measure_closing(gripper, hand.scene, postures)
    bench["hopeless"] = False
    if speed > 1e-3:
        raise UnmetError(
            f"closed without an object, it still moves at {1e3 * speed:.1f} mm/s "
            f"after {gripper.equilibrium.limit_s:g} s"
        )
    return f"moves a joint by {1e3 * moved:.0f} mm and comes to rest"


def _measured(bench: dict[str, Any]) -> GripperMeasurement:
    measured: GripperMeasurement | None = bench.get("measured")
    if measured is None:
        raise UnmetError("unknown, as the fingers were not seen to close on one another")
    return measured


def _opening(gripper: Gripper, bench: dict[str, Any]) -> str:
    return check_opening(_measured(bench), gripper.max_opening_m)


def _aligned(gripper: Gripper, bench: dict[str, Any]) -> str:
    return _corrected(gripper, bench, check_aligned)


def _centred(gripper: Gripper, bench: dict[str, Any]) -> str:
    return _corrected(gripper, bench, check_centred)


def _corrected(
    gripper: Gripper, bench: dict[str, Any], check: Callable[[GripperMeasurement], str]
) -> str:
    """Run a check of the TCP; where it fails, let the measured one grasp from then on."""
    measured = _measured(bench)
    try:
        return check(measured)
    except UnmetError:
        bench["grasper"] = Corrected(gripper, measured.base_T_tcp)
        raise


def _reopens(gripper: Gripper, bench: dict[str, Any]) -> str:
    hand, closing = bench["hand"], gripper.closing
    hand.ramp(closing.close, closing.open, closing.seconds)
    hand.command(closing.open, 1.0)
    difference = float(np.abs(hand.scene.posture() - bench["open"]).max())
    if difference > 1e-3:
        raise UnmetError(f"a joint is {1e3 * difference:.1f} mm from its open position")
    return f"back to open within {1e3 * difference:.2f} mm"


def _column(bench: dict[str, Any], mass_kg: float = 0.3) -> GraspObject:
    """Return the test column, deep enough to tell x of the TCP from y."""
    measured = bench.get("measured")
    square = measured is None or measured.all_sides
    depth = bench["width"] * (1.0 if square else _DEEP)
    return standing_column(bench["width"], depth_m=depth, mass_kg=mass_kg)


def _holds(gripper: Gripper, bench: dict[str, Any]) -> str:
    width, grasper = bench["width"], bench["grasper"]
    column = _column(bench)
    runner = bench["runner"] = TrialRunner(column, grasper)
    depths: list[float] = [0.0]

    def watch(model: Any, data: Any, phase: str) -> None:
        depths.append(runner.scene.hand_overlap_m())

    grasp = grasp_of_column(grasper, width)
    outcome = runner.run(np.eye(4), grasp, early_stop=False, record=watch)
    # While the column still stands on the table: a weak hand would lose it in the lift.
    hand = ParkedHand(runner.scene, runner.sim_T_base(np.eye(4), grasp))
    pressed = hand.grip_n(gripper.closing)
    bench["held"], bench["depth"], bench["pressed"] = outcome, max(depths), pressed
    needed = column.mass_kg * _GRAVITY / (2 * column.friction)
    press = f"the fingers press with {pressed:.1f} N a side"
    with_measured = "" if grasper is gripper else ", with the measured TCP"
    if outcome.success:
        return (
            f"a column of {1e3 * width:.0f} mm moved by {1e3 * outcome.offset_m:.1f} mm in the "
            f"hand; {press}{with_measured}"
        )
    if outcome.stop:
        raise UnmetError(
            f"the hand {outcome.stop}, on the way to a column of {1e3 * width:.0f} mm: does it "
            "open when told to, and is the TCP between the fingertips, its z out along the fingers?"
        )
    what = (
        f"a column of {1e3 * width:.0f} mm and {column.mass_kg:g} kg, grasped without error"
        f"{with_measured}, was {outcome.reason} (offset {1e3 * outcome.offset_m:.0f} mm)"
    )
    if 0 < pressed < _WEAK * needed:
        raise UnmetError(
            f"weak grip: {press}, and {needed:.1f} N are needed at a friction of "
            f"{column.friction:g} at rest, more in motion; {what}; give the actuators more force "
            "(gain, forcerange)"
        )
    if not pressed:
        raise UnmetError(f"{what}; at the end of closing the fingers do not press on it")
    raise UnmetError(f"{what}; {press}, of which {needed:.1f} N would do: does it slip or tilt?")


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
    grasp = grasp_of_column(gripper, bench["width"], raised)
    outcome = runner.run(np.eye(4), grasp, early_stop=False)
    if outcome.reason != "missed":
        raise UnmetError(f"grasping {1e3 * raised:.0f} mm too high was {outcome.reason}")
    return f"grasping {1e3 * raised:.0f} mm too high leaves the column standing"


def _drops(gripper: Gripper, bench: dict[str, Any]) -> str:
    width = bench["width"]
    heavy = TrialRunner(_column(bench, mass_kg=100.0), bench["grasper"])
    outcome = heavy.run(np.eye(4), grasp_of_column(gripper, width))
    if outcome.reason not in ("dropped", "slipped", "missed"):
        raise UnmetError(
            f"a column of 100 kg was {outcome.reason}: is any actuator without a force limit?"
        )
    return f"a column of 100 kg is {outcome.reason}"


def _repeats(gripper: Gripper, bench: dict[str, Any]) -> str:
    runner: TrialRunner = bench["runner"]
    grasp = grasp_of_column(gripper, bench["width"])
    again = runner.run(np.eye(4), grasp, early_stop=False)
    fresh = TrialRunner(_column(bench), bench["grasper"])
    anew = fresh.run(np.eye(4), grasp, early_stop=False)
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
    ("opening", _opening),
    ("aligned", _aligned),
    ("centred", _centred),
    ("reopens", _reopens),
    ("holds", _holds),
    ("solid", _solid),
    ("misses", _misses),
    ("drops", _drops),
    ("repeats", _repeats),
)
_NEEDED = ("describes", "compiles", "actuators", "touches", "opens")
