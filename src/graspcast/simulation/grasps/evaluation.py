"""Evaluation of a reference grasp: jittered perfect estimates, agreement with observed outcomes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool
from numpy import ndarray

from graspcast.pose.transforms import exp
from graspcast.simulation.grasps.agreement import Agreement, agreement
from graspcast.simulation.grasps.sampling import LabelledTrials
from graspcast.simulation.grasps.table import ReferenceGrasp
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.objects.types import Grasp, GraspObject
from graspcast.simulation.trial.trial import TrialRunner, TrialSettings

__all__ = ["evaluate_grasp", "held_under_jitter", "simulate_success"]


def held_under_jitter(runner: TrialRunner, grasp: Grasp, count: int = 20, seed: int = 0) -> int:
    """Count the successes among perfect estimates with a jitter of 1 mm and 1 degree.

    The jitter is normal in a uniform direction; 1 mm and 1 degree are its root mean squares.
    """
    rng = np.random.default_rng(seed)
    scale = np.repeat([1e-3, np.deg2rad(1.0)], 3) / np.sqrt(3)
    twists = rng.standard_normal((count, 6)) * scale
    return sum(runner.run(exp(t), grasp).success for t in twists)


def simulate_success(
    runner: TrialRunner, grasp: Grasp, trials: LabelledTrials
) -> Bool[ndarray, " n"]:
    """Run the trials and return whether each succeeds in simulation."""
    return np.array([runner.run(e, grasp).success for e in trials.obj_T_est], dtype=bool)


def evaluate_grasp(
    reference: ReferenceGrasp,
    grasp_object: GraspObject,
    gripper: Gripper,
    trials: LabelledTrials,
    *,
    settings: TrialSettings | None = None,
) -> Agreement:
    """Return the agreement of simulated with observed outcomes, over all trials at full length."""
    runner = TrialRunner(reference.applied_to(grasp_object), gripper, settings)
    return agreement(simulate_success(runner, reference.grasp, trials), trials.success)
