"""Protocol of grippers: model, mounting, tool centre point and closing command."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Protocol, runtime_checkable

from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.io.hashing import canonical_json, sha256
from graspcast.pose.lengths import Reference, unit_problem

__all__ = ["ApproachLimits", "Closing", "Equilibrium", "Gripper", "gripper_digest"]

LONGEST_S = 60.0
"""Longest time that a hand may take to close, or to come to rest."""

_MOTIONS = Reference("a hand at rest moves by less than 10 mm", 0.0, 0.01, (1e-6, 2e-3))
_SHORT = Reference("an arm approaches from less than 2 m", 0.0, 2.0, (5e-4, 0.1))
_MOST_N = 1e6
_LEVERS = Reference("fingers are shorter than 1 m", 0.0, 1.0, (5e-3, 0.3))


@dataclass(frozen=True)
class Closing:
    """Closing command: a linear ramp of each actuator's control from open to closed.

    If the hand comes to rest on the object before the ramp ends, the ramp goes on in the lift.

    Attributes
    ----------
    open
        Control of each actuator of the hand when open, in the actuator's unit.
    close
        Control of the same actuators when closed, held until the end of the trial.
    seconds
        Duration of the ramp.
    """

    open: Mapping[str, float]
    close: Mapping[str, float]
    seconds: float

    def __post_init__(self) -> None:
        if set(self.open) != set(self.close) or not self.open:
            raise InputError(
                f"open names the actuators {sorted(self.open)} and close {sorted(self.close)}: "
                "both must name the same ones, and at least one"
            )
        if not 0 < self.seconds <= LONGEST_S:
            raise InputError(
                f"closing takes {self.seconds} s; give a time above zero, at most {LONGEST_S:g} s"
            )


@dataclass(frozen=True)
class Equilibrium:
    """Largest changes over ``window_s`` at which the closing hand counts as at rest.

    Attributes
    ----------
    window_s
        Time over which changes are measured.
    motion_m
        Largest motion of any finger joint and of the object; of a hinge, the arc at ``lever_m``.
    lever_m
        Lever that converts angles to distances.
    force_fraction
        Largest change of any actuator's force, as a fraction of its largest force.
    limit_s
        Time after which the lift starts without equilibrium.
    """

    window_s: float = 0.06
    motion_m: float = 2e-4
    lever_m: float = 0.05
    force_fraction: float = 0.05
    limit_s: float = 2.5

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not 0 < value < math.inf:
                raise InputError(f"equilibrium {name} is {value}; it must be > 0")
        if not self.window_s <= self.limit_s <= LONGEST_S:
            raise InputError(
                f"equilibrium limit_s is {self.limit_s}; give at least window_s ({self.window_s} "
                f"s) and at most {LONGEST_S:g} s"
            )
        for name, usual in (("motion_m", _MOTIONS), ("lever_m", _LEVERS)):
            if problem := unit_problem(f"equilibrium {name}", getattr(self, name), usual, unit="m"):
                raise InputError(problem)


@dataclass(frozen=True)
class ApproachLimits:
    """Limits on the approach that a gripper sets in place of those of the trial's settings.

    Attributes
    ----------
    force_n
        Contact force on the hand above which the arm stops, newtons; None for the default.
    short_m
        Distance by which the hand may stop short of its goal, metres; None for the default.
    """

    force_n: float | None = None
    short_m: float | None = None

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if value is not None and not 0 < value <= _MOST_N:
                raise InputError(
                    f"approach {name} is {value}; it must be above zero, at most {_MOST_N:g}"
                )
        if self.short_m is not None and (
            problem := unit_problem("approach short_m", self.short_m, _SHORT, unit="m")
        ):
            raise InputError(problem)


@runtime_checkable
class Gripper(Protocol):
    """Gripper: model, mounting, tool centre point and commands.

    A gripper may also have ``approach``, its :class:`ApproachLimits`.

    :func:`graspcast.simulation.trial.gripper_conformance.check_gripper` checks an implementation.
    """

    @property
    def name(self) -> str:
        """Short name, as in reference grasps and campaigns."""

    @property
    def base_T_tcp(self) -> Float[ndarray, "4 4"]:
        """Tool centre point in the hand's base frame, metres.

        Its z is the direction of approach, from the palm out along the fingers; its x is the
        direction in which the fingers close.
        """

    @property
    def max_opening_m(self) -> float:
        """Distance between the open fingers along x of the TCP."""

    @property
    def closing(self) -> Closing:
        """Closing command."""

    @property
    def equilibrium(self) -> Equilibrium:
        """Criterion for the end of closing."""

    @property
    def self_collision(self) -> bool:
        """Whether parts of the hand collide with one another."""

    def spec(self) -> Any:
        """Return a new ``mujoco.MjSpec``; its only root body, without joint, is the base."""


def gripper_digest(gripper: Gripper) -> str:
    """Return the SHA-256, as hex, of everything in a gripper that a trial depends on."""
    spec = gripper.spec()
    assets = [part for item in sorted(spec.assets.items()) for part in item]
    values = {
        "name": gripper.name,
        "base_T_tcp": gripper.base_T_tcp.tolist(),
        "closing": [dict(gripper.closing.open), dict(gripper.closing.close)],
        "seconds": gripper.closing.seconds,
        "equilibrium": asdict(gripper.equilibrium),
        "self_collision": gripper.self_collision,
    }
    return sha256(spec.to_xml(), *assets, canonical_json(values))
