"""What a gripper must be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Protocol, runtime_checkable

from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.io.hashing import canonical_json, sha256

__all__ = ["Closing", "Equilibrium", "Gripper", "gripper_digest"]


@dataclass(frozen=True)
class Closing:
    """How a gripper is opened and closed: each actuator's control goes linearly to its end value.

    The ramp goes on during the lift if the hand comes to rest on the object before its end.

    Attributes
    ----------
    open
        Control of every actuator of the hand when open, in the actuator's unit.
    close
        Control of the same actuators when closed, held until the end of the trial.
    seconds
        Duration of the ramp from open to closed.
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
        if not self.seconds > 0:
            raise InputError(f"closing takes {self.seconds} s; give a time above zero")


@dataclass(frozen=True)
class Equilibrium:
    """When the closing hand has come to rest: nothing changed by more than this over ``window_s``.

    Attributes
    ----------
    window_s
        The time over which changes are measured.
    motion_m
        Largest motion of any finger joint and of the object; a hinge counts by the arc that it
        moves at ``lever_m``.
    lever_m
        Lever that turns angles into distances.
    force_fraction
        Largest change of any actuator's force, as a part of the largest force.
    limit_s
        After this time the trial goes on whether or not there is an equilibrium.
    """

    window_s: float = 0.06
    motion_m: float = 2e-4
    lever_m: float = 0.05
    force_fraction: float = 0.05
    limit_s: float = 2.5

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not value > 0:
                raise InputError(f"equilibrium {name} is {value}; it must be > 0")


@runtime_checkable
class Gripper(Protocol):
    """A gripper: its model, where it is mounted, its tool centre point and how it is commanded.

    ``graspcast.simulation.trial.gripper_conformance.check_gripper`` tells whether an object is one.
    """

    @property
    def name(self) -> str:
        """A short name, as in reference grasps and campaigns."""

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
        """How it is opened and closed."""

    @property
    def equilibrium(self) -> Equilibrium:
        """When closing has come to rest."""

    @property
    def self_collision(self) -> bool:
        """Whether the hand's own parts collide with one another."""

    def spec(self) -> Any:
        """A fresh ``mujoco.MjSpec`` whose only root body, without a joint, is the hand's base."""


def gripper_digest(gripper: Gripper) -> str:
    """SHA-256, as hex, over everything about a gripper that a trial depends on."""
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
