"""Recording of a trial: its states over time, for pictures and films."""

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
    """Poses and joint positions at one time of a trial.

    Attributes
    ----------
    phase
        ``"approach"``, ``"close"`` or ``"lift"``.
    time_s
        Time since the hand left the pre-grasp, seconds.
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
    """States of a trial, at least one, and its outcome.

    Attributes
    ----------
    outcome
        The outcome.
    states
        The states, in order of time.
    sim_T_est
        Estimated pose of the object in the scene.
    """

    outcome: Outcome
    states: tuple[State, ...]
    sim_T_est: Float[ndarray, "4 4"]

    def of(self, phase: str) -> tuple[State, ...]:
        """Return the states of a phase; none if the trial ended before it."""
        return tuple(state for state in self.states if state.phase == phase)

    def overlay(self, state: State) -> Float[ndarray, "4 4"] | None:
        """Return the pose at which to draw the estimate over a state, or None.

        The estimate is not drawn during the lift, nor where it is nearly perfect, because two
        surfaces in one place flicker.
        """
        off = invert(self.states[0].sim_T_obj) @ self.sim_T_est
        apart = np.linalg.norm(off[:3, 3]) > _SAME_M or rotation_angle(off[:3, :3]) > _SAME_RAD
        return self.sim_T_est if apart and state.phase != "lift" else None

    def every(self, seconds: float) -> list[State]:
        """Return the last state before each of equally spaced times, and the final state."""
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
    """Run a trial as :meth:`TrialRunner.run` does, and record its states.

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
        # States of an unstable simulation cannot be drawn.
        if all(np.abs(pose).max() < _FARTHEST_M for pose in poses):
            seen.append((phase, float(data.time), *poses, data.qpos[joints]))

    outcome = runner.run(obj_T_est, grasp, early_stop=early_stop, record=record)
    if not seen:
        away = float(np.linalg.norm(obj_T_est[:3, 3]))
        raise InputError(
            f"the estimate is {away:.3g} m off, too far to draw the trial", parameters=("offset",)
        )
    states = _timed(seen, runner.settings.approach_speed)
    return Recording(outcome, states, runner.grasp_object.sim_T_ref @ obj_T_est)


def _timed(
    seen: list[tuple[str, float, ndarray, ndarray, ndarray]], speed: float
) -> tuple[State, ...]:
    """Assign times to states; the free part of the approach takes no simulated time.

    The search for the first contact looks a little beyond the place where simulation starts; those
    states are dropped.
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
        # The pre-grasp is recorded twice.
        if reached and (not kept or times[k] > times[kept[-1]]):
            kept.append(k)
    return tuple(State(seen[k][0], times[k], *seen[k][2:]) for k in kept)
