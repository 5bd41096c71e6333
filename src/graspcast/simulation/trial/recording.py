"""What a trial looked like: its states in order of time, to be drawn afterwards."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.pose.transforms import invert, rotation_angle, transform
from graspcast.simulation.objects.types import Grasp
from graspcast.simulation.trial.trial import Outcome, TrialRunner

__all__ = ["Recording", "State", "record_trial"]

_FARTHEST_M = 20.0
_SAME_M, _SAME_RAD = 5e-4, 5e-3


@dataclass(frozen=True, eq=False)
class State:
    """Where everything is at one time of a trial.

    Attributes
    ----------
    phase
        ``"approach"``, ``"close"`` or ``"lift"``.
    time_s
        Since the hand left the pre-grasp.
    sim_T_obj, sim_T_base
        Poses of the object and of the hand's base.
    hand_joints
        Positions of the hand's joints, in the model's order; metres or radians.
    """

    phase: str
    time_s: float
    sim_T_obj: Float[ndarray, "4 4"]
    sim_T_base: Float[ndarray, "4 4"]
    hand_joints: Float[ndarray, " j"]


@dataclass(frozen=True, eq=False)
class Recording:
    """A trial's states, at least one, and what came of it.

    Attributes
    ----------
    outcome
        The outcome.
    states
        In order of time.
    sim_T_est
        Where the estimate says that the object is.
    """

    outcome: Outcome
    states: tuple[State, ...]
    sim_T_est: Float[ndarray, "4 4"]

    def of(self, phase: str) -> tuple[State, ...]:
        """The states of a phase; none if the trial ended before it."""
        return tuple(state for state in self.states if state.phase == phase)

    def overlay(self, state: State) -> Float[ndarray, "4 4"] | None:
        """Where the estimate is to be drawn over a state, if it is.

        Not in the lift, which it has nothing to say about, and not where it is as good as perfect:
        two surfaces in one place flicker.
        """
        off = invert(self.states[0].sim_T_obj) @ self.sim_T_est
        apart = np.linalg.norm(off[:3, 3]) > _SAME_M or rotation_angle(off[:3, :3]) > _SAME_RAD
        return self.sim_T_est if apart and state.phase != "lift" else None

    def every(self, seconds: float) -> list[State]:
        """The last state before each of equally spaced times, and the last of all."""
        times = np.array([state.time_s for state in self.states])
        asked = np.arange(times[0], times[-1], seconds)
        rows = np.searchsorted(times, asked + 1e-9, side="right") - 1
        return [*(self.states[int(row)] for row in rows), self.states[-1]]


def record_trial(
    runner: TrialRunner,
    obj_T_est: Float[ndarray, "4 4"],
    grasp: Grasp,
    *,
    early_stop: bool = True,
) -> Recording:
    """Run a trial as :meth:`TrialRunner.run` does, and keep what is to be seen of it.

    Raises
    ------
    InputError, MismatchError
        As :meth:`TrialRunner.run`.
    """
    scene = runner.scene
    joints = scene.model.jnt_qposadr[scene.hand_joints]
    seen: list[tuple[str, float, ndarray, ndarray, ndarray]] = []

    def record(model: Any, data: Any, phase: str) -> None:
        poses = [
            transform(data.xmat[body].reshape(3, 3), data.xpos[body])
            for body in (scene.object_body, scene.base_body)
        ]
        # A simulation that blew up has no picture.
        if all(np.abs(pose).max() < _FARTHEST_M for pose in poses):
            seen.append((phase, float(data.time), *poses, data.qpos[joints]))

    outcome = runner.run(obj_T_est, grasp, early_stop=early_stop, record=record)
    if not seen:
        away = float(np.linalg.norm(obj_T_est[:3, 3]))
        raise InputError(f"the estimate is {away:.3g} m off: there is nothing to be seen of this")
    states = _timed(seen, runner.settings.approach_speed)
    return Recording(outcome, states, runner.grasp_object.sim_T_ref @ obj_T_est)


def _timed(
    seen: list[tuple[str, float, ndarray, ndarray, ndarray]], speed: float
) -> tuple[State, ...]:
    """Put the way to the first contact, which takes no simulated time, before the rest.

    The search for that contact looks a little beyond the place where physics begins; those states
    are dropped.
    """
    start = seen[0][3][:3, 3]

    def way(k: int) -> float:
        return float(np.linalg.norm(seen[k][3][:3, 3] - start)) / speed

    physical = next((k for k, state in enumerate(seen) if state[1] > 0), None)
    begin = np.inf if physical is None else way(physical)
    if physical is not None and seen[physical][0] == "approach":
        begin -= seen[physical][1]
    times = [way(k) if state[1] == 0 else begin + state[1] for k, state in enumerate(seen)]
    kept: list[int] = []
    for k, state in enumerate(seen):
        reached = state[1] > 0 or times[k] <= begin + 1e-9
        # The pre-grasp is looked at twice.
        if reached and (not kept or times[k] > times[kept[-1]]):
            kept.append(k)
    return tuple(State(seen[k][0], times[k], *seen[k][2:]) for k in kept)
