"""Settings of a trial: every parameter besides the object, the gripper and the grasp."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

from graspcast.errors import InputError
from graspcast.io.hashing import canonical_json, sha256
from graspcast.pose.lengths import Reference, unit_problem
from graspcast.simulation.grippers.protocol import ApproachLimits, Gripper

__all__ = ["PROTOCOLS", "Protocol", "TrialSettings"]

Protocol = Literal["robot", "paper"]
PROTOCOLS: tuple[Protocol, ...] = ("robot", "paper")

_LENGTHS = {
    "standoff_m": Reference("an arm approaches from less than 2 m", 0.0, 2.0, (0.01, 0.5)),
    "tolerance_m": Reference("a hand grasps objects of up to 1 m", 0.0, 1.0, (0.005, 0.3)),
    "overlap_m": Reference("a hand grasps objects of up to 1 m", 0.0, 0.1, (0.0, 0.01)),
    "goal_overlap_m": Reference("a hand grasps objects of up to 1 m", 0.0, 0.1, (0.0, 0.01)),
    "short_m": Reference("an arm approaches from less than 2 m", 0.0, 2.0, (5e-4, 0.1)),
    "torsion_m": Reference("a patch of contact is smaller than 0.1 m", 0.0, 0.1, (0.0, 0.02)),
}
_MOST = {
    **{"approach_speed": 10.0, "lift_speed": 10.0, "lift_s": 600.0, "settle_s": 60.0},
    **{"timestep": 0.05, "arm_force_n": 1e6},
    **{"contact_force_n": 1e6, "contact_s": 10.0},
}
_PAPER_OVERLAP_M = 0.003
_OF_CONTACT = ("contact_force_n", "contact_s", "short_m")


@dataclass(frozen=True)
class TrialSettings:
    """Parameters of a trial (Sections III-B and IV-C of the paper) and of its contact model.

    The lift time is from the paper and the tolerance (5 cm) from the authors' release; the other
    values are choices of this project.

    There are two protocols. By the *robot's*, the default, a trial ends as ``collided`` when the
    hand meets something on the approach; its limits are ``contact_force_n``, ``contact_s`` and
    ``short_m``. By the *paper's*, :meth:`paper`, the trial is blocked if the open hand would end
    its approach in the object (``goal_overlap_m``); otherwise the arm presses on, whatever the hand
    meets. With it the published outcomes are reproduced.

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
    contact_force_n
        On the approach the arm stops if the net force of contacts on the hand is above this,
        newtons; None for no limit. The default, a choice, is twice the 20 N at which libfranka's
        examples and franka_ros let a Franka arm stop, and less than half of the 100 N to which the
        manual of the UR5e limits that arm in recovery mode (with an accuracy of 25 N). An object of
        1 kg that is pushed aside resists with less than 10 N.
    contact_s
        Time for which the force must last, seconds, so that the blow of the first touch, which
        fades within 20 ms, does not count.
    short_m
        The arm has also collided if at the end of the approach the hand is farther than this from
        its goal, metres; None for no limit. It matters where the arm is weaker than
        ``contact_force_n``.
    overlap_m
        The trial is blocked if the open hand starts deeper than this in object or table.
    goal_overlap_m
        The trial is also blocked if the open hand, at the pose to which it is to go, would be
        deeper than this in the object at rest, metres; None for no limit. With a limit, as in the
        paper's protocol, contact on the way in is a failure, however the object would give way.
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
    solver
        MuJoCo's tolerance of the constraint solver until the hand grips, and how it stores
        Jacobians. With those of ``grip_solver`` trials would be cheaper still, but rounding decides
        marginal trials in this part: a few in a thousand would get another label.
    grip_solver
        The same from when the closing hand has gripped the object. The tolerance is far below
        MuJoCo's default, and steps cost less: the solver starts from the solution of the step
        before, and what a loose tolerance leaves there costs more iterations than it saves.
    """

    standoff_m: float = 0.10
    approach_speed: float = 0.10
    lift_speed: float = 0.10
    lift_s: float = 15.0
    lift_ramp_s: float = 0.25
    tolerance_m: float = 0.05
    settle_s: float = 0.1
    arm_force_n: float = 100.0
    contact_force_n: float | None = 40.0
    contact_s: float = 0.05
    short_m: float | None = 0.005
    overlap_m: float = 0.001
    goal_overlap_m: float | None = None
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
    solver: tuple[float, Literal["dense", "sparse"]] = (1e-8, "dense")
    grip_solver: tuple[float, Literal["dense", "sparse"]] = (1e-14, "sparse")

    def __post_init__(self) -> None:
        positive = ("standoff_m", "approach_speed", "lift_speed", "lift_s", "tolerance_m")
        for name in (*positive, "arm_force_n", "timestep", "impratio", "iterations"):
            if not getattr(self, name) > 0:
                raise InputError(f"trial setting {name} is {getattr(self, name)}; it must be > 0")
        for name in ("contact_force_n", "short_m", "goal_overlap_m"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise InputError(
                    f"trial setting {name} is {value}; it must be > 0, or None for no limit"
                )
        not_negative = ("contact_s", "settle_s", "lift_ramp_s", "overlap_m", "noslip_iterations")
        for name in (*not_negative, "torsion_m"):
            if not getattr(self, name) >= 0:
                raise InputError(f"trial setting {name} is {getattr(self, name)}; it must be >= 0")
        for name in ("solver", "grip_solver"):
            if not 0 <= getattr(self, name)[0] <= 1:
                raise InputError(
                    f"trial setting {name} has the tolerance {getattr(self, name)[0]}; it must be "
                    "between 0 and 1"
                )
        for name, limit in _LENGTHS.items():
            if getattr(self, name) is None:
                continue
            if problem := unit_problem(
                f"trial setting {name}", getattr(self, name), limit, unit="m"
            ):
                raise InputError(problem)
        for name, most in _MOST.items():
            if getattr(self, name) is not None and not getattr(self, name) <= most:
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

    @classmethod
    def robot(
        cls,
        gripper: Gripper | None = None,
        *,
        contact_force_n: float | None = None,
        short_m: float | None = None,
    ) -> TrialSettings:
        """Return the robot's protocol, with the limits of a gripper where it states them.

        Parameters
        ----------
        gripper
            The gripper; its ``approach``, if it has one, replaces the defaults.
        contact_force_n, short_m
            Limits that replace both.
        """
        own = getattr(gripper, "approach", None) or ApproachLimits()
        default = cls()
        return replace(
            default,
            contact_force_n=_first(contact_force_n, own.force_n, default.contact_force_n),
            short_m=_first(short_m, own.short_m, default.short_m),
        )

    @classmethod
    def paper(cls) -> TrialSettings:
        """Return the paper's protocol, with which the published outcomes are reproduced.

        What the authors' simulator makes of contact on the way in is not published. The limit of
        the overlap, one for all objects and both hands, was chosen on the train images: see
        docs/validation.md.
        """
        return cls(contact_force_n=None, short_m=None, goal_overlap_m=_PAPER_OVERLAP_M)

    @property
    def protocol(self) -> Protocol:
        """``"robot"`` if a limit of contact on the approach is set, else ``"paper"``."""
        return "paper" if self.contact_force_n is None and self.short_m is None else "robot"

    @property
    def lift_height_m(self) -> float:
        """Height of the lift, metres."""
        return self.lift_speed * (self.lift_s - 0.5 * self.lift_ramp_s)

    def as_dict(self) -> dict[str, Any]:
        """Return the settings that trials depend on, as a dictionary for JSON."""
        # Without limits the approach is not watched, and the digest is as it was before them.
        unused = {*(_OF_CONTACT if self.protocol == "paper" else ())}
        unused |= {"goal_overlap_m"} if self.goal_overlap_m is None else set()
        return {name: value for name, value in asdict(self).items() if name not in unused}

    def digest(self) -> str:
        """Return the SHA-256 of all settings, as hex."""
        return sha256(canonical_json(self.as_dict()))


def _first(*values: float | None) -> float | None:
    """Return the first value that is given."""
    return next((value for value in values if value is not None), None)
