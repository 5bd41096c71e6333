"""Measurement of a gripper in simulation: closing direction, gap, opening, approach, grip force."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.io.conformance import UnmetError
from graspcast.pose.transforms import quaternion, transform
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.trial.gripper_bench import ParkedHand, standing_column
from graspcast.simulation.trial.gripper_gap import Gap, gap_of
from graspcast.simulation.trial.gripper_motion import ClosingMotion, closing_motion
from graspcast.simulation.trial.scene import Scene, build_scene
from graspcast.simulation.trial.settings import TrialSettings

__all__ = ["Corrected", "GripperMeasurement", "measure_closing", "measure_gripper"]

_OPEN_S = 0.5


@dataclass(frozen=True, eq=False)
class GripperMeasurement:
    """What a gripper does in simulation, in the frame of its stated tool centre point (TCP).

    Attributes
    ----------
    all_sides
        Whether the fingers close from all sides, so that no direction of closing stands out.
    closing
        Direction in which the fingers close, a unit vector; of a hand that closes from all sides,
        the axis to which they close.
    approach
        Direction from the palm out through the gap between the fingers, a unit vector.
    gap_m
        Centre of the gap between the fingers, where they touch an object half as wide as the
        opening, metres.
    touch_m
        From where to where along z the fingers touch objects of all widths, metres.
    tip_m
        How far the fingers reach along z, metres.
    opening_m
        Distance between the open fingers, metres.
    grip_n
        Force with which each side presses on an object half as wide as the opening, newtons; NaN
        if unknown.
    base_T_tcp
        Tool centre point that the measurement suggests, in the hand's base frame.
    """

    all_sides: bool
    closing: Float[ndarray, " 3"]
    approach: Float[ndarray, " 3"]
    gap_m: Float[ndarray, " 3"]
    touch_m: tuple[float, float]
    tip_m: float
    opening_m: float
    grip_n: float
    base_T_tcp: Float[ndarray, "4 4"]

    @property
    def closing_angle_deg(self) -> float:
        """Angle between the direction of closing and x of the TCP, 0 to 90 degrees."""
        return _angle_deg(abs(float(self.closing[0])))

    @property
    def approach_angle_deg(self) -> float:
        """Angle between the approach and z of the TCP, 0 to 180 degrees."""
        return _angle_deg(float(self.approach[2]))

    def with_grip(self, grip_n: float) -> GripperMeasurement:
        """Return the same with a grip force."""
        return replace(self, grip_n=grip_n)

    def as_toml(self) -> str:
        """Return the measured tool centre point as lines of a gripper's TOML file."""
        position = ", ".join(f"{value + 0.0:.4f}" for value in self.base_T_tcp[:3, 3].round(4))
        wxyz = quaternion(self.base_T_tcp[:3, :3]).round(6)
        turned = ", ".join(f"{value + 0.0:.6f}" for value in wxyz)
        return f"tcp_position_m = [{position}]\ntcp_quaternion = [{turned}]"

    def rows(self, gripper: Gripper) -> list[tuple[str, str, str]]:
        """Return rows of a table: quantity, measured, and what the gripper states."""
        x, y, z = (1e3 * float(value) for value in self.gap_m)
        low, high = (1e3 * value for value in self.touch_m)
        closes = "from all sides" if self.all_sides else _in_words(self.closing, either=True)
        grip = "unknown" if np.isnan(self.grip_n) else f"{self.grip_n:.1f} N a side"
        position = "{:.1f}, {:.1f}, {:.1f} mm"
        stated = position.format(*(1e3 * gripper.base_T_tcp[:3, 3]))
        centre = position.format(*(1e3 * self.base_T_tcp[:3, 3]))
        return [
            ("closing direction", closes, "x of the TCP"),
            ("approach", _in_words(self.approach, either=False), "z of the TCP"),
            ("gap centre from the TCP (x, y, z)", position.format(x, y, z), "0, 0, 0"),
            ("fingers touch along z of the TCP", f"{low:.1f} to {high:.1f} mm", "0"),
            ("gap centre in the base frame", centre, f"TCP at {stated}"),
            ("opening", f"{1e3 * self.opening_m:.1f} mm", f"{1e3 * gripper.max_opening_m:.1f} mm"),
            (f"grip force on {500 * gripper.max_opening_m:.0f} mm", grip, ""),
        ]


def measure_gripper(gripper: Gripper) -> GripperMeasurement | None:
    """Close a gripper on nothing in simulation, and measure all but its grip force.

    Parameters
    ----------
    gripper
        The gripper.

    Returns
    -------
        None if the fingers were not seen to close on one another.

    Raises
    ------
    UnmetError
        If the fingers move apart as they close.
    MismatchError
        If the simulation of the open hand is unstable.
    """
    column = standing_column(0.5 * gripper.max_opening_m)
    hand = ParkedHand(build_scene(column, gripper, TrialSettings()))
    hand.command(gripper.closing.open, _OPEN_S)
    postures = hand.close(gripper.closing, gripper.equilibrium.limit_s)
    return measure_closing(gripper, hand.scene, postures)


def measure_closing(
    gripper: Gripper, scene: Scene, postures: list[ndarray]
) -> GripperMeasurement | None:
    """Measure a hand from its postures on the way from open to closed.

    Parameters
    ----------
    gripper
        The gripper.
    scene
        A scene with it; its state is the same afterwards.
    postures
        ``data.qpos`` from open to closed.

    Returns
    -------
        None if the fingers were not seen to close on one another.

    Raises
    ------
    UnmetError
        If they move apart.
    """
    state = scene.data.qpos.copy()
    motion, back = closing_motion(scene, postures), closing_motion(scene, postures[::-1])
    scene.data.qpos[:] = state
    if back is not None and (motion is None or back.nearer_m > 2 * motion.nearer_m):
        raise UnmetError(
            f"it closes outwards: from open to closed the fingers move apart by "
            f"{1e3 * back.nearer_m:.0f} mm; exchange open and close"
        )
    gap = None if motion is None else gap_of(scene, postures, motion)
    if motion is None or gap is None:
        return None
    return _in_tcp(gripper, motion, gap)


def _in_tcp(gripper: Gripper, motion: ClosingMotion, gap: Gap) -> GripperMeasurement:
    rotation, origin = gripper.base_T_tcp[:3, :3], gripper.base_T_tcp[:3, 3]
    axis, approach = motion.axis, gap.approach
    x = rotation[:, 0] if motion.all_sides else axis
    x = x - (x @ approach) * approach
    x = x / np.linalg.norm(x) if np.linalg.norm(x) > 1e-6 else rotation[:, 0]
    if x @ rotation[:, 0] < 0:
        x = -x
    suggested = np.stack([x, np.cross(approach, x), approach], axis=1)
    at_tcp = float(origin @ approach)
    return GripperMeasurement(
        all_sides=motion.all_sides,
        closing=axis @ rotation,
        approach=approach @ rotation,
        gap_m=(gap.centre - origin) @ rotation,
        touch_m=(gap.low_m - at_tcp, gap.high_m - at_tcp),
        tip_m=gap.tip_m - at_tcp,
        opening_m=gap.opening_m,
        grip_n=float("nan"),
        base_T_tcp=transform(suggested, gap.centre),
    )


class Corrected:
    """A gripper with another tool centre point.

    Parameters
    ----------
    gripper
        The gripper.
    base_T_tcp
        The tool centre point in its base frame.
    """

    def __init__(self, gripper: Gripper, base_T_tcp: Float[ndarray, "4 4"]):
        self._gripper, self.base_T_tcp = gripper, base_T_tcp

    def __getattr__(self, name: str) -> Any:
        return getattr(self._gripper, name)


def _angle_deg(cosine: float) -> float:
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _in_words(direction: Iterable[float], *, either: bool) -> str:
    """Return a direction as the nearest axis of the TCP and the angle to it."""
    components = np.array(list(direction))
    k = int(np.abs(components).argmax())
    sign = "-" if components[k] < 0 and not either else ""
    angle = _angle_deg(abs(float(components[k])))
    return f"{sign}{'xyz'[k]} of the TCP" + (f", {angle:.0f}° off" if angle >= 0.5 else "")
