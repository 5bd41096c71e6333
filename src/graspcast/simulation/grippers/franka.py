"""Franka Hand: a parallel gripper, modelled with primitives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.pose.transforms import transform
from graspcast.simulation.grippers.protocol import Closing, Equilibrium

__all__ = ["FrankaHand"]

_GREY, _DARK = (0.86, 0.87, 0.88, 1.0), (0.2, 0.21, 0.23, 1.0)


@dataclass(frozen=True)
class FrankaHand:
    """Franka Hand: two fingers on one drive that close along y of the base and point along z.

    Stroke, frames, pads and masses are those of MuJoCo Menagerie's model; the grip force is chosen
    within the manual's range of 30 to 70 N (continuous).

    Attributes
    ----------
    grip_n
        Grip force of each finger, N.
    finger_speed
        Speed of each finger, m/s (the manual's 50 mm/s).
    stroke_m
        Travel of each finger, metres.
    stiffness
        Stiffness of the drive's position servo, N/m; it saturates at ``grip_n``.
    reflected_kg
        Inertia of the drive reflected to each finger, kg.
    gear_damping
        Viscous friction of the drive on each finger, Ns/m. It limits the speed of a finger that
        slips off an edge while the servo is saturated.
    """

    grip_n: float = 60.0
    finger_speed: float = 0.05
    stroke_m: float = 0.04
    stiffness: float = 1e4
    reflected_kg: float = 0.2
    gear_damping: float = 500.0

    def __post_init__(self) -> None:
        if not 30.0 <= self.grip_n <= 70.0:
            raise InputError(
                f"grip_n is {self.grip_n} N; the Franka Hand grips with 30 to 70 N continuously"
            )

    @property
    def name(self) -> str:
        """``"parallel"``."""
        return "parallel"

    @property
    def max_opening_m(self) -> float:
        """Distance between the open pads: 80 mm."""
        return 2 * self.stroke_m

    @cached_property
    def base_T_tcp(self) -> Float[ndarray, "4 4"]:
        """Tool centre point 103.4 mm in front of the base, its x along the base's y."""
        rotation = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        return transform(rotation, np.array([0.0, 0.0, 0.1034]))

    @cached_property
    def closing(self) -> Closing:
        """Both fingers at ``finger_speed``, to a target beyond contact for the full force."""
        beyond = -2.0 * self.grip_n / self.stiffness
        seconds = (self.max_opening_m - beyond) / (2 * self.finger_speed)
        return Closing({"fingers": self.max_opening_m}, {"fingers": beyond}, seconds)

    @property
    def equilibrium(self) -> Equilibrium:
        """The default criterion."""
        return Equilibrium()

    @property
    def self_collision(self) -> bool:
        """False: the joint limits prevent contact of the fingers."""
        return False

    def spec(self) -> Any:
        """Return the model: a box for the body, and a box and a pad for each finger."""
        from graspcast.simulation.engine import mujoco

        spec = mujoco.MjSpec()
        hand = spec.worldbody.add_body(name="hand")
        # The housing, 63 x 205 mm, with its face 66 mm in front of the base.
        hand.add_geom(
            name="housing",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=(0.0315, 0.1025, 0.046),
            pos=(0, 0, 0.02),
            mass=0.73,
            rgba=_GREY,
        )
        for side in ("left", "right"):
            self._add_finger(hand, side)
        # One drive moves both fingers, so neither can push the other back.
        drive = spec.add_equality(
            name="one drive",
            type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            name1="left",
            name2="right",
            solref=(0.006, 1),
            solimp=(0.98, 0.999, 0.0005, 0.5, 2),
        )
        drive.data = np.zeros(len(drive.data))  # 11 numbers or 12, by MuJoCo's version
        drive.data[1] = 1.0
        tendon = spec.add_tendon(name="opening")
        tendon.wrap_joint("left", 1.0)
        tendon.wrap_joint("right", 1.0)
        drive = spec.add_actuator(
            name="fingers",
            trntype=mujoco.mjtTrn.mjTRN_TENDON,
            target="opening",
            forcerange=(-self.grip_n, self.grip_n),
            forcelimited=True,
        )
        drive.set_to_position(kp=self.stiffness)
        return spec

    def _add_finger(self, hand: Any, side: str) -> None:
        from graspcast.simulation.engine import mujoco

        box = mujoco.mjtGeom.mjGEOM_BOX
        finger = hand.add_body(name=f"{side}_finger", pos=(0, 0, 0.0584))
        if side == "right":
            finger.quat = (0, 0, 0, 1)
        finger.add_joint(
            name=side,
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=(0, 1, 0),
            range=(0, self.stroke_m),
            armature=self.reflected_kg,
            damping=(self.gear_damping, 0, 0),
            solref_limit=(0.006, 1),
            solimp_limit=(0.98, 0.999, 0.0005, 0.5, 2),
        )
        finger.add_geom(
            name=f"{side}_link",
            type=box,
            size=(0.01, 0.007, 0.018),
            pos=(0, 0.0165, 0.018),
            mass=0.011,
            rgba=_GREY,
        )
        # One flat pad replaces the four corners around a groove; its face is in their plane.
        finger.add_geom(
            name=f"{side}_pad",
            type=box,
            size=(0.0085, 0.00475, 0.0085),
            pos=(0, 0.00475, 0.0445),
            mass=0.004,
            rgba=_DARK,
        )
