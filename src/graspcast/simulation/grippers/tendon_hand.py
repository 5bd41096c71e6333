"""Underactuated, tendon-driven hand: two fingers and a thumb on one motor.

After Chen, Wang, Haas-Heger and Ciocarlie, "Underactuation Design for Tendon-Driven Hands via
Optimization of Mechanically Realizable Manifolds in Posture and Torque Spaces" (T-RO 2020), and
Chen, He and Ciocarlie, "Hardware as Policy" (CoRL 2020). Link lengths and widths, the number of
joints and the principle of actuation are from these papers; what they do not publish is assumed.
"""

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

__all__ = ["TendonHand"]

_GREY, _BLUE, _DARK = (0.80, 0.81, 0.83, 1.0), (0.27, 0.47, 0.70, 1.0), (0.2, 0.21, 0.23, 1.0)
_DIGITS = ("thumb", "upper", "lower")


@dataclass(frozen=True)
class TendonHand:
    """Tendon-driven hand: digits along -z of the base, the thumb at -x, two fingers at +x.

    Lengths in metres, angles in radians, torques in newton metres. Every digit has a proximal and
    a distal flexion joint; a pair is (proximal, distal).

    Attributes
    ----------
    links_m
        Lengths of the links (published).
    radius_m
        Radius of the links, half of the published width.
    link_masses_kg
        Masses of the links (assumed).
    finger_gap_m
        Distance between the two fingers (published).
    base_gap_m
        Distance from thumb base to finger base (read off a published drawing).
    open_rad
        Joint angles at the open stops (assumed, like all that follows).
    closed_rad
        Joint angles at the closed stops.
    pulleys_m
        Radii on which the tendon flexes the joints. A fingertip pinch balances where the ratio
        distal / proximal is l / (proximal length + l), l from the distal joint.
    springs
        Stiffness of the extending springs, Nm/rad.
    preload
        Torque of the springs at the open stops, Nm.
    damping
        Damping of every joint, Nms/rad.
    armature
        Armature of every joint, kg m^2.
    tendon_stiffness
        Stiffness of each tendon, N/m; a tendon only pulls.
    motor_n
        Largest force of the motor, shared by the three tendons, N.
    motor_kg
        Inertia of the motor reflected to the tendons, kg.
    motor_stiffness
        Stiffness of the motor's position servo, N/m.
    motor_damping
        Viscous friction of the motor, Ns/m; it also acts when the servo is saturated.
    travel_m
        Commanded tendon travel.
    close_s
        Duration of the command's ramp, seconds.
    tcp_depth_m
        Distance of the tool centre point from the palm's face.
    """

    links_m: tuple[float, float] = (0.050, 0.040)
    radius_m: float = 0.012
    link_masses_kg: tuple[float, float] = (0.030, 0.022)
    finger_gap_m: float = 0.050
    base_gap_m: float = 0.070
    open_rad: tuple[float, float] = (-0.80, 0.20)
    closed_rad: tuple[float, float] = (1.20, 1.60)
    pulleys_m: tuple[float, float] = (0.010, 0.004)
    springs: tuple[float, float] = (0.04, 0.04)
    preload: tuple[float, float] = (0.020, 0.012)
    damping: float = 0.003
    armature: float = 5e-4
    tendon_stiffness: float = 2e4
    motor_n: float = 200.0
    motor_kg: float = 2.0
    motor_stiffness: float = 5e4
    motor_damping: float = 400.0
    travel_m: float = 0.030
    close_s: float = 0.8
    tcp_depth_m: float = 0.075

    def __post_init__(self) -> None:
        for name in ("pulleys_m", "links_m", "link_masses_kg", "springs"):
            if min(getattr(self, name)) <= 0:
                raise InputError(f"tendon hand: {name} is {getattr(self, name)}; all must be > 0")
        if not all(low < high for low, high in zip(self.open_rad, self.closed_rad, strict=True)):
            raise InputError("tendon hand: open_rad must be below closed_rad in both joints")

    @property
    def name(self) -> str:
        """``"underactuated"``."""
        return "underactuated"

    @cached_property
    def max_opening_m(self) -> float:
        """Distance between the open tips of thumb and fingers."""
        first, second = self.open_rad[0], sum(self.open_rad)
        reach = -self.links_m[0] * np.sin(first) - self.links_m[1] * np.sin(second)
        return float(self.base_gap_m + 2 * reach - 2 * self.radius_m)

    @cached_property
    def base_T_tcp(self) -> Float[ndarray, "4 4"]:
        """Tool centre point in front of the palm, its z along -z of the base, its x along x."""
        return transform(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, -self.tcp_depth_m]))

    @cached_property
    def closing(self) -> Closing:
        """The motor winds the tendons; on an object it saturates, so the tension is constant."""
        return Closing({"motor": 0.0}, {"motor": self.travel_m}, self.close_s)

    @property
    def equilibrium(self) -> Equilibrium:
        """The default criterion."""
        return Equilibrium()

    @property
    def self_collision(self) -> bool:
        """False: the thumb passes between the fingers."""
        return False

    def spec(self) -> Any:
        """Return the model: a box for the palm, capsules for the links, fixed tendons."""
        from graspcast.simulation.engine import mujoco

        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        palm = spec.worldbody.add_body(name="palm")
        palm.add_geom(
            name="palm",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=(0.050, 0.045, 0.035),
            pos=(0, 0, 0.035),
            mass=0.6,
            rgba=_GREY,
        )
        half = 0.5 * self.base_gap_m
        self._digit(palm, "thumb", (-half, 0.0, 0.0), turned=True)
        self._digit(palm, "upper", (half, 0.5 * self.finger_gap_m, 0.0), turned=False)
        self._digit(palm, "lower", (half, -0.5 * self.finger_gap_m, 0.0), turned=False)
        # The motor's inertia is armature, so it does not affect the motion of the hand.
        motor = palm.add_body(name="motor", pos=(0, 0, 0.035))
        motor.mass, motor.inertia, motor.explicitinertial = 1e-3, (1e-7, 1e-7, 1e-7), True
        motor.add_joint(
            name="travel",
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=(0, 1, 0),
            armature=self.motor_kg,
            damping=(self.motor_damping, 0, 0),
        )
        for digit in _DIGITS:
            tendon = spec.add_tendon(name=digit, stiffness=(self.tendon_stiffness, 0, 0))
            tendon.wrap_joint("travel", 1.0)
            tendon.wrap_joint(f"{digit}_proximal", -self.pulleys_m[0])
            tendon.wrap_joint(f"{digit}_distal", -self.pulleys_m[1])
            # Slack below the rest length, which is that of the open hand: the tendon only pulls.
            rest = -float(np.dot(self.pulleys_m, self.open_rad))
            tendon.springlength = (-1.0, rest)
        stiffness = self.motor_stiffness + 3 * self.tendon_stiffness
        damping = max(0.0, 2.0 * np.sqrt(stiffness * self.motor_kg) - self.motor_damping)
        drive = spec.add_actuator(
            name="motor",
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            target="travel",
            forcerange=(-self.motor_n, self.motor_n),
            forcelimited=True,
        )
        drive.set_to_position(kp=self.motor_stiffness, kv=damping)
        return spec

    def _digit(
        self, palm: Any, name: str, base: tuple[float, float, float], *, turned: bool
    ) -> None:
        from graspcast.simulation.engine import mujoco

        parent, pos = palm, base
        for k, part in enumerate(("proximal", "distal")):
            body = parent.add_body(name=f"{name}_{part}", pos=pos)
            if turned and k == 0:
                body.quat = (0, 0, 0, 1)
            body.add_joint(
                name=f"{name}_{part}",
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=(0, 1, 0),
                range=(self.open_rad[k], self.closed_rad[k]),
                stiffness=(self.springs[k], 0, 0),
                springref=self.open_rad[k] - self.preload[k] / self.springs[k],
                damping=(self.damping, 0, 0),
                armature=self.armature,
                solref_limit=(0.006, 1),
            )
            body.add_geom(
                name=f"{name}_{part}",
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=(0, 0, 0, 0, 0, -self.links_m[k]),
                size=(self.radius_m, 0, 0),
                mass=self.link_masses_kg[k],
                rgba=_BLUE if k == 0 else _DARK,
            )
            parent, pos = body, (0.0, 0.0, -self.links_m[k])
