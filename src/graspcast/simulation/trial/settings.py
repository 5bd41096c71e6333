"""Settings of a trial: every parameter besides the object, the gripper and the grasp."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from graspcast.errors import InputError
from graspcast.io.hashing import canonical_json, sha256
from graspcast.pose.lengths import Reference, unit_problem

__all__ = ["TrialSettings"]

_LENGTHS = {
    "standoff_m": Reference("an arm approaches from less than 2 m", 0.0, 2.0, (0.01, 0.5)),
    "tolerance_m": Reference("a hand grasps objects of up to 1 m", 0.0, 1.0, (0.005, 0.3)),
    "overlap_m": Reference("a hand grasps objects of up to 1 m", 0.0, 0.1, (0.0, 0.01)),
    "torsion_m": Reference("a patch of contact is smaller than 0.1 m", 0.0, 0.1, (0.0, 0.02)),
}
_MOST = {
    **{"approach_speed": 10.0, "lift_speed": 10.0, "lift_s": 600.0, "settle_s": 60.0},
    **{"timestep": 0.05, "arm_force_n": 1e6},
}


@dataclass(frozen=True)
class TrialSettings:
    """Parameters of a trial (Sections III-B and IV-C of the paper) and of its contact model.

    The lift time is from the paper and the tolerance (5 cm) from the authors' release; the other
    values are choices of this project.

    Attributes
    ----------
    standoff_m
        Distance of the pre-grasp from the grasp, along the approach.
    approach_speed
        Speed of the approach, m/s.
    lift_speed
        Speed of the lift, m/s, reached within ``lift_ramp_s``.
    lift_s
        Duration of the lift, including the ramp.
    lift_ramp_s
        Time in which the lift reaches its speed.
    tolerance_m
        Success if the object's centroid moves by at most this in the hand's frame.
    settle_s
        Pause between the end of the approach and the start of closing.
    arm_force_n
        Largest force with which the arm pushes the hand along its approach.
    overlap_m
        The trial is blocked if the open hand starts deeper than this in object or table.
    hand_touches_table
        Whether the hand collides with the table; the object always does.
    timestep
        Duration of a simulation step, seconds.
    integrator
        MuJoCo's integrator.
    cone
        MuJoCo's friction cone.
    impratio
        MuJoCo's ratio of frictional to normal constraint impedance. With the elliptic cone, 2000
        keeps creep below 10 um/s at no cost; with 10 it is 150 um/s.
    noslip_iterations
        MuJoCo's no-slip iterations, a slower way to reduce creep.
    condim
        Dimension of the contacts of the object with the hand: 3 sliding, 4 with torsion.
    torsion_m
        Torsional friction, as MuJoCo has it (the radius of the contact patch), metres.
    solref
        MuJoCo's contact time constant (s) and damping ratio.
    solimp
        MuJoCo's contact impedance: at touch, at ``width``, and the width in metres.
    iterations
        Limit of the constraint solver.
    """

    standoff_m: float = 0.10
    approach_speed: float = 0.10
    lift_speed: float = 0.10
    lift_s: float = 15.0
    lift_ramp_s: float = 0.25
    tolerance_m: float = 0.05
    settle_s: float = 0.1
    arm_force_n: float = 100.0
    overlap_m: float = 0.001
    hand_touches_table: bool = True
    timestep: float = 0.002
    integrator: Literal["euler", "implicit", "implicitfast", "rk4"] = "implicitfast"
    cone: Literal["elliptic", "pyramidal"] = "elliptic"
    impratio: float = 2000.0
    noslip_iterations: int = 0
    condim: Literal[3, 4, 6] = 4
    torsion_m: float = 0.005
    solref: tuple[float, float] = (0.006, 1.0)
    solimp: tuple[float, float, float] = (0.95, 0.99, 0.001)
    iterations: int = 50

    def __post_init__(self) -> None:
        positive = ("standoff_m", "approach_speed", "lift_speed", "lift_s", "tolerance_m")
        for name in (*positive, "arm_force_n", "timestep", "impratio", "iterations"):
            if not getattr(self, name) > 0:
                raise InputError(f"trial setting {name} is {getattr(self, name)}; it must be > 0")
        for name in ("settle_s", "lift_ramp_s", "overlap_m", "noslip_iterations", "torsion_m"):
            if not getattr(self, name) >= 0:
                raise InputError(f"trial setting {name} is {getattr(self, name)}; it must be >= 0")
        for name, limit in _LENGTHS.items():
            if problem := unit_problem(
                f"trial setting {name}", getattr(self, name), limit, unit="m"
            ):
                raise InputError(problem)
        for name, most in _MOST.items():
            if not getattr(self, name) <= most:
                raise InputError(
                    f"trial setting {name} is {getattr(self, name)}; it must be at most {most:g}"
                )
        if self.lift_ramp_s >= self.lift_s:
            raise InputError(f"lift_ramp_s ({self.lift_ramp_s}) must be below lift_s")
        if self.solref[0] < 2 * self.timestep:
            raise InputError(
                f"solref {self.solref[0]} s is below twice the timestep ({self.timestep} s): "
                "contacts would be unstable; raise solref or lower the timestep"
            )
        if self.lift_height_m <= 2 * self.tolerance_m:
            raise InputError(
                f"the lift ends after {self.lift_height_m:.3f} m, too low to detect a failure: "
                f"it must be more than twice the tolerance of {self.tolerance_m} m"
            )

    @property
    def lift_height_m(self) -> float:
        """Height of the lift, metres."""
        return self.lift_speed * (self.lift_s - 0.5 * self.lift_ramp_s)

    def as_dict(self) -> dict[str, Any]:
        """Return all settings as a dictionary for JSON."""
        return asdict(self)

    def digest(self) -> str:
        """Return the SHA-256 of all settings, as hex."""
        return sha256(canonical_json(self.as_dict()))
