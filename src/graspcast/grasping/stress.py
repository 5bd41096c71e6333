"""Harder questions than whether one trial succeeds: jittered copies, tugs and shaking."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.grasping.trial import Outcome, TrialRunner
from graspcast.pose.transforms import exp
from graspcast.simulation.objects.types import Grasp

__all__ = ["Graded", "Stress", "StressOutcome", "graded", "stress"]

_GRAVITY = 9.81
_STEP_S = 0.02
_AXES = {"x": 0, "y": 1, "z": 2}


@dataclass(frozen=True)
class Graded:
    """The share of jittered copies of an estimate that were held, and each one's outcome."""

    score: float
    outcomes: tuple[Outcome, ...]


def graded(
    runner: TrialRunner,
    obj_T_est: Float[ndarray, "4 4"],
    grasp: Grasp,
    *,
    copies: int = 6,
    distance_m: float = 0.002,
    angle_rad: float = math.radians(1.0),
    seed: int = 0,
) -> Graded:
    """Success as a grade between 0 and 1: over copies of an estimate, each moved a little.

    Args:
        runner: Of the object and the gripper.
        obj_T_est: The estimate, seen from the true object.
        grasp: The reference grasp.
        copies: How many copies; the estimate itself is not among them.
        distance_m: Standard deviation of each coordinate of the moves.
        angle_rad: Standard deviation of each component of the turns.
        seed: Of the moves; the same seed moves every estimate alike.

    Raises:
        InputError: if ``copies`` is below one.
    """
    if copies < 1:
        raise InputError(f"copies is {copies}; a grade needs at least one")
    scales = np.repeat([distance_m, angle_rad], 3)
    moves = exp(scales * np.random.default_rng(seed).normal(size=(copies, 6)))
    outcomes = tuple(runner.run(obj_T_est @ move, grasp) for move in moves)
    return Graded(sum(outcome.success for outcome in outcomes) / copies, outcomes)


@dataclass(frozen=True)
class Stress:
    """Forces on the held object, as multiples of its weight, along the axes of the hand's base.

    Attributes:
        tug_g: Strength of a steady pull in each of six directions.
        tug_s: Its duration.
        shake_g: Amplitude of a sinusoidal force along each of three axes: what the object feels
            in a hand that is shaken.
        shake_hz: Its frequency.
        shake_s: Its duration.
    """

    tug_g: float = 1.0
    tug_s: float = 0.5
    shake_g: float = 1.0
    shake_hz: float = 3.0
    shake_s: float = 1.0

    def course(self) -> Iterator[tuple[str, ndarray]]:
        """Every load's name and its course, (steps of 20 ms, 3), in multiples of the weight."""
        for name, axis in _AXES.items():
            for sign, direction in (("+", 1.0), ("-", -1.0)):
                pull = np.zeros((math.ceil(self.tug_s / _STEP_S), 3))
                pull[:, axis] = direction * self.tug_g
                yield f"tug {sign}{name}", pull
        for name, axis in _AXES.items():
            times = _STEP_S * np.arange(math.ceil(self.shake_s / _STEP_S))
            shake = np.zeros((len(times), 3))
            shake[:, axis] = self.shake_g * np.sin(2 * np.pi * self.shake_hz * times)
            yield f"shake {name}", shake


@dataclass(frozen=True)
class StressOutcome:
    """What came of the trial, and of the loads after it.

    Attributes:
        trial: The trial before the loads.
        failed_at: The load at which the object moved in the hand by more than the trial's
            tolerance: ``"tug +x"`` … ``"shake z"``. None if it bore them all, ``"trial"`` if it
            was not held to begin with.
        offset_m: How far it had moved in the hand since the end of the lift, at the end or at the
            failure; NaN if it was not held to begin with.
    """

    trial: Outcome
    failed_at: str | None
    offset_m: float


def stress(
    runner: TrialRunner,
    obj_T_est: Float[ndarray, "4 4"],
    grasp: Grasp,
    loads: Stress | None = None,
) -> StressOutcome:
    """Try a grasp and, if it is held, tug at the object and shake it.

    Args:
        runner: Of the object and the gripper.
        obj_T_est: The estimate, seen from the true object.
        grasp: The reference grasp.
        loads: The forces.
    """
    trial = runner.run(obj_T_est, grasp)
    if not trial.success:
        return StressOutcome(trial, "trial", math.nan)
    scene = runner.scene
    model, data = scene.model, scene.data
    steps = max(1, round(_STEP_S / model.opt.timestep))
    lift = model.actuator("lift").id
    speed = runner.settings.lift_speed
    for part in np.linspace(1.0, 0.0, 26)[1:]:
        data.ctrl[lift] = part * speed
        mujoco.mj_step(model, data, nstep=steps)
    before = scene.centroid_in_base()
    weight = runner.grasp_object.mass_kg * _GRAVITY
    offset = 0.0
    for name, course in (loads or Stress()).course():
        for load in course:
            axes = data.xmat[scene.base_body].reshape(3, 3)
            data.xfrc_applied[scene.object_body, :3] = weight * (axes @ load)
            mujoco.mj_step(model, data, nstep=steps)
        data.xfrc_applied[:] = 0.0
        offset = float(np.linalg.norm(scene.centroid_in_base() - before))
        if scene.exploded() or not offset <= runner.settings.tolerance_m:
            return StressOutcome(trial, name, offset)
    return StressOutcome(trial, None, offset)
