"""Benchmark of trials against MuJoCo alone, on the same models and states.

    python benchmarks/trial_rate.py [--trials 60] [--seed 0]

For each gripper and object it runs trials with errors like those of pose estimators and prints

- steps/s of whole trials, and of their calls of ``mj_step`` alone: the ratio is the overhead of the
  trial's own logic (required: 0.90 or more);
- trials/s with early stopping, and steps per trial.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from graspcast.pose.transforms import exp
from graspcast.simulation.grippers import GRIPPERS, load_gripper
from graspcast.simulation.objects.types import ConvexPiece, Grasp, GraspObject
from graspcast.simulation.trial import trial
from graspcast.simulation.trial.gripper_bench import standing_column


class Stopwatch:
    """Replacement of mj_step that measures the time spent in it."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._step = mujoco.mj_step

    def __call__(self, model: Any, data: Any, nstep: int = 1) -> None:
        started = time.perf_counter()
        self._step(model, data, nstep=nstep)
        self.seconds += time.perf_counter() - started


def objects() -> list[tuple[str, GraspObject, float]]:
    """Return a column of one box and a can of eight convex pieces, with their grasp heights."""
    column = standing_column(0.05)
    can = standing_column(0.066)
    angles = np.linspace(0, 2 * np.pi, 33)
    pieces = []
    for k in range(0, 32, 4):
        rim = 0.033 * np.stack([np.cos(angles[k : k + 5]), np.sin(angles[k : k + 5])], axis=1)
        wedge = np.concatenate([rim, [[0.0, 0.0]]])
        solid = [np.column_stack([wedge, np.full(len(wedge), z)]) for z in (-0.05, 0.05)]
        pieces.append(ConvexPiece(np.concatenate(solid), np.zeros((0, 3), dtype=np.int64)))
    standing = np.eye(4)
    standing[2, 3] = 0.05
    can = replace(can, name="can", pieces=tuple(pieces), mass_kg=0.35, sim_T_ref=standing)
    return [("box", column, 0.05), ("can of 8 pieces", can, 0.02)]


def main() -> None:
    parser = argparse.ArgumentParser(description="Rate of trials against bare mj_step.")
    parser.add_argument("--trials", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    print(f"MuJoCo {mujoco.__version__}, {options.trials} trials a row, seed {options.seed}")
    print(
        f"{'gripper':12} {'object':16} {'trial steps/s':>14} {'mj_step steps/s':>16} {'ratio':>6} "
        f"{'trials/s':>9} {'steps/trial':>12}  outcomes"
    )
    for name in GRIPPERS:
        for label, target, height in objects():
            row(name, label, target, height, options.trials, options.seed)


def row(name: str, label: str, target: GraspObject, height: float, count: int, seed: int) -> None:
    runner = trial.TrialRunner(target, load_gripper(name))
    obj_T_grasp = np.diag([1.0, -1.0, -1.0, 1.0])
    obj_T_grasp[2, 3] = height
    grasp = Grasp(obj_T_grasp, target.name, name)
    rng = np.random.default_rng(seed)
    scales = np.repeat([0.012, 0.12], 3)
    errors = [exp(rng.choice([0.3, 1.0, 2.0]) * scales * rng.normal(size=6)) for _ in range(count)]
    runner.run(errors[0], grasp)
    watch = Stopwatch()
    trial.mujoco.mj_step = watch
    try:
        started = time.perf_counter()
        outcomes = [runner.run(error, grasp) for error in errors]
        seconds = time.perf_counter() - started
    finally:
        trial.mujoco.mj_step = watch._step
    steps = sum(outcome.steps for outcome in outcomes)
    reasons = Counter(outcome.reason for outcome in outcomes)
    print(
        f"{name:12} {label:16} {steps / seconds:14,.0f} {steps / watch.seconds:16,.0f} "
        f"{watch.seconds / seconds:6.3f} {count / seconds:9.1f} {steps / count:12.0f}  "
        + ", ".join(f"{reason} {n}" for reason, n in reasons.most_common())
    )


if __name__ == "__main__":
    main()
