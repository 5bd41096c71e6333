"""Looking again when in doubt, on published outcomes of scenes that are not in training.

The scenes are left out of training in four parts. Grasps are guided by single-view estimates, whose
outcomes are published, so a further look changes the forecast, not the pose. A grasp is attempted
from the threshold on.

    python benchmarks/policy.py --data DATA
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import polars as pl

from graspcast.estimates.loading import Inputs, load_inputs
from graspcast.estimates.outcomes import read_outcomes
from graspcast.evaluation.bootstrap import Interval, original_and_draws
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.looking import run_policy
from graspcast.forecasting.recorded_verdicts import ViewSettings
from graspcast.forecasting.train import fit_forecaster
from graspcast.forecasting.training_data import TrainingData
from graspcast.forecasting.view_data import fuse_for_training
from graspcast.io.markdown import table
from graspcast.paper.dataset import ESTIMATORS, GRIPPERS
from graspcast.views.camera_motion import CameraMotion
from graspcast.views.camera_tables import read_camera_motion
from graspcast.views.fused_estimates import fuse_estimates

OBJECTS = ("2", "3", "4", "5", "8", "9", "12")
SCENES = range(48, 60)
FOLDS = 4


def inputs_of(data: Path, scenes: list[int]) -> Inputs:
    published = data / "published" / "ycbv"
    tables = {name: published / f"{name}_ycbv-test.csv" for name in ESTIMATORS}
    return load_inputs(
        tables,
        bop=[data / "bop" / "ycbv"],
        ground_truth=[published / "ground_truth"],
        objects=OBJECTS,
        scenes=scenes,
        lenient=True,
    )


def trained(
    inputs: Inputs, outcomes: pl.DataFrame, motion: CameraMotion, gripper: str
) -> Forecaster:
    first = ESTIMATORS[0]
    estimates = inputs.estimates(first)
    truth = inputs.truth(estimates, first)
    data = TrainingData.join(estimates, outcomes, first, gripper, truth=truth)
    views = fuse_for_training(inputs, {"ycbv": motion}, estimates, first)
    return fit_forecaster(replace(data, views=views), models=inputs.models)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--threshold", type=float, default=0.8)
    parser.add_argument("--views-from", choices=("all", "earlier"), default="all")
    parser.add_argument(
        "--expected",
        action="store_true",
        help="instead: how the expected probability after a look agrees with the one found there",
    )
    options = parser.parse_args()
    published = options.data / "published" / "ycbv"
    outcomes = read_outcomes(published / "trials.csv")
    motion = read_camera_motion(published / "camera_motion")
    if options.expected:
        print(expectations(options.data, outcomes, motion))
        return
    rows = []
    for gripper in GRIPPERS:
        found: dict[tuple[str, int], list[tuple[int, bool, int, int]]] = {}
        for fold in range(FOLDS):
            test = [s for s in SCENES if s % FOLDS == fold]
            train = inputs_of(options.data, [s for s in SCENES if s not in test])
            forecaster = trained(train, outcomes, motion, gripper)
            asked = inputs_of(options.data, test)
            for guide in ESTIMATORS:
                mine = outcomes.filter(estimator=guide, gripper=gripper)
                held = {
                    key: success
                    for *key_list, success in mine.select(
                        "scene_id", "im_id", "obj_id", "success"
                    ).rows()
                    for key in [tuple(key_list)]
                }
                for most in (1, 2, 3):
                    settings = ViewSettings(views_from=options.views_from, max_looks=most)
                    run = run_policy(
                        forecaster.guided_by(guide),
                        asked,
                        "ycbv",
                        motion,
                        settings,
                        threshold=options.threshold,
                    )
                    for row, looks in zip(run.rows, run.looks.tolist(), strict=True):
                        success = held.get((row.key.scene_id, row.key.im_id, row.key.obj_id))
                        if success is not None:
                            one = (row.key.scene_id, row.verdict.attempt, int(success), looks)
                            found.setdefault((guide, most), []).append(one)
        rows += [[gripper, *summary(most, found)] for most in (1, 2, 3)]
    print(table(["gripper", "looks", "attempted", "succeed", "mean looks", "always"], rows))


def expectations(data: Path, outcomes: pl.DataFrame, motion: CameraMotion) -> str:
    """Compare expected probabilities with those after the next look, guided by the fused pose."""
    forecaster = trained(inputs_of(data, list(SCENES[:-3])), outcomes, motion, "parallel")
    asked = inputs_of(data, list(SCENES[-3:]))
    judged = []
    for most in (1, 2, 3):
        fused = fuse_estimates(
            asked.results["ycbv"],
            motion,
            dataset="ycbv",
            models=asked.models,
            views_from="all",
            max_views=most,
        )
        settings = {"guide": "fused", "threshold": 1.0, "max_looks": 5, "min_gain": -1.0}
        judged.append(forecaster.judge(fused, asked.models, **settings))
    rows = []
    for most, (now, then) in enumerate(pairwise(judged), start=1):
        values = [
            (a.verdict.probability, a.verdict.look.expected_probability, b.verdict.probability)
            for a, b in zip(now, then, strict=True)
            if a.verdict.look is not None
        ]
        known = np.array([v for v in values if None not in v], dtype=float)
        agreement = np.corrcoef(known[:, 1], known[:, 2])[0, 1]
        means = [f"{mean:.3f}" for mean in known.mean(axis=0)]
        rows.append([str(most), str(len(known)), *means, f"{agreement:.3f}"])
    return table(["looks", "n", "now", "expected", "found", "correlation"], rows)


def summary(most: int, found: dict[tuple[str, int], list[tuple[int, bool, int, int]]]) -> list[str]:
    """Return attempt and success rates, means over guides, with intervals by drawing scenes."""
    counts = original_and_draws([str(s) for s in SCENES], 2000, 0)
    sums = np.zeros((4, len(ESTIMATORS), len(counts)))
    for k, guide in enumerate(ESTIMATORS):
        scene, attempt, success, looks = (
            np.array(c) for c in zip(*found[guide, most], strict=True)
        )
        number = scene - SCENES[0]
        n, tried, good, held, taken = (
            counts @ np.bincount(number, weights=w, minlength=len(SCENES))
            for w in (np.ones(len(scene)), attempt, attempt * success, success, looks)
        )
        sums[:, k] = tried / n, good / tried, taken / n, held / n
    means = sums.mean(axis=1)
    values = [str(Interval.of(m[0], m[1:], (0.0, 1.0))) for m in means[[0, 1, 3]]]
    return [f"up to {most}", values[0], values[1], f"{means[2, 0]:.2f}", values[2]]


if __name__ == "__main__":
    main()
