"""Synthetic estimates, outcomes and ground truth that follow a known rule."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from itertools import product

import numpy as np
import polars as pl

from graspcast.bop.models import Models
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.instances import Instances
from graspcast.evaluation.benchmark import Benchmark
from graspcast.forecasting.simulated_trials import SimulatedTrials
from graspcast.forecasting.training_data import TrainingData
from poses import nudged, random_poses


def estimates(
    n: int = 120,
    *,
    seed: int = 0,
    objects: tuple[int, ...] = (1, 2),
    scenes: int = 6,
    dataset: str = "d",
    names: tuple[str, ...] = ("a", "b", "c"),
) -> Estimates:
    """K estimators' poses; the supporters of every other instance are far off."""
    truth = random_poses(n, seed)
    far = (np.arange(n) // len(objects)) % 2 == 0
    poses = []
    for k, _ in enumerate(names):
        near = nudged(truth, seed + k, metres=0.002, radians=0.02)
        off = nudged(truth, seed + k, metres=0.04, radians=0.4)
        poses.append(np.where(far[:, None, None] & (k > 0), off, near))
    return Estimates(
        estimators=names,
        instances=Instances(
            dataset=np.full(n, dataset),
            scene_id=np.arange(n) * scenes // n,
            im_id=np.arange(n),
            obj_id=np.array(objects)[np.arange(n) % len(objects)],
            est_id=np.zeros(n, np.int64),
        ),
        cam_T_obj=np.stack(poses),
    )


def with_keys(given: Estimates, **columns: np.ndarray) -> Estimates:
    """The same poses, of instances with other keys."""
    return dataclasses.replace(given, instances=dataclasses.replace(given.instances, **columns))


def own_outcomes(
    given: Estimates, own_success: np.ndarray, principal: str | None = None
) -> TrainingData:
    """Training data with outcomes of one principal (the first by default) and no ground truth."""
    principal = principal or given.estimators[0]
    success = np.full((len(given.estimators), len(given)), np.nan)
    success[given.index(principal)] = own_success
    truth = np.full((len(given), 4, 4), np.nan)
    return TrainingData(given, principal, "parallel", truth, success)


def tried(n: int = 120, *, seed: int = 0, noise: float = 0.05, **options: object) -> TrainingData:
    """Grasps guided by the first estimator succeed where the next one agrees, with some noise."""
    given = estimates(n, seed=seed, **options)  # type: ignore[arg-type]
    apart = np.linalg.norm(given.cam_T_obj[0, :, :3, 3] - given.cam_T_obj[1, :, :3, 3], axis=-1)
    success = (apart < 0.02) ^ (np.random.default_rng(seed).random(n) < noise)
    return own_outcomes(given, success)


def outcomes_of(
    given: Estimates, grippers: tuple[str, ...] = ("p", "u"), *, seed: int = 0
) -> pl.DataFrame:
    """Trials with every estimator as principal; success where the next one agrees, with noise."""
    rng = np.random.default_rng(seed)
    place = given.cam_T_obj[:, :, :3, 3]
    keys = {
        name: getattr(given, name).tolist()
        for name in ("dataset", "scene_id", "im_id", "obj_id", "est_id")
    }
    tables = []
    for k, gripper in product(range(len(given.estimators)), grippers):
        apart = np.linalg.norm(place[k] - place[k - 1], axis=-1)
        success = (apart < 0.02) ^ (rng.random(len(given)) < 0.2)
        names = {"estimator": pl.lit(given.estimators[k]), "gripper": pl.lit(gripper)}
        trials = pl.DataFrame({**keys, "success": success.astype(np.int64)})
        tables.append(trials.with_columns(**names))
    return pl.concat(tables)


def benchmark(models: Mapping[str, Models], n: int = 120, *, simulated: bool = True) -> Benchmark:
    """Benchmark of two objects in six scenes, with two grippers, a split, and simulated trials."""
    given = estimates(n)
    trials = outcomes_of(given)
    part = np.where(np.random.default_rng(9).random(len(trials)) < 0.2, "test", "train")
    return Benchmark(
        estimates=given,
        truth=random_poses(n, 0),
        outcomes=trials,
        split=trials.rename({"estimator": "principal"}).with_columns(split=pl.Series(part)),
        models=models,
        reported=given.im_id % 3 == 0,
        simulated=outcomes_of(given, seed=5) if simulated else None,
    )


def true_poses(n: int, seed: int = 0) -> np.ndarray:
    """True poses of :func:`estimates` of the same number and seed."""
    return random_poses(n, seed)


def training_data(n: int = 120, *, seed: int = 0, **options: object) -> TrainingData:
    """Outcomes of all estimators; success where the error is below 20 mm along the object's x."""
    given = estimates(n, seed=seed, **options)  # type: ignore[arg-type]
    truth = true_poses(n, seed)
    # The principal has large errors where the others disagree with it.
    poses = given.cam_T_obj.copy()
    far = np.linalg.norm(poses[0, :, :3, 3] - poses[1, :, :3, 3], axis=-1) > 0.02
    poses[0, far] = nudged(poses[0, far], seed + 77, metres=0.05, radians=0.4)
    given = dataclasses.replace(given, cam_T_obj=poses)
    error = np.linalg.inv(truth) @ given.cam_T_obj
    return TrainingData(given, given.estimators[0], "parallel", truth, holds(error).astype(float))


def several_grasps(n: int = 120, count: int = 2, **options: object) -> TrainingData:
    """As :func:`training_data`, with grasps g1, g2, ... that need small errors along other axes."""
    data = training_data(n, **options)  # type: ignore[arg-type]
    error = np.linalg.inv(data.truth) @ data.estimates.cam_T_obj
    others = {
        f"g{i}": (np.abs(error[..., i % 3, 3]) < 0.015 + 0.005 * (i % 2)).astype(float)
        for i in range(1, count + 1)
    }
    return dataclasses.replace(data, others=others)


def holds(obj_T_est: np.ndarray) -> np.ndarray:
    """Which pose errors the synthetic grasp succeeds with."""
    return np.abs(obj_T_est[..., 0, 3]) < 0.02


def error_outcomes(n: int, name: str, *, seed: int = 0) -> SimulatedTrials:
    """Simulated trials of an object by random errors."""
    error = nudged(np.tile(np.eye(4), (n, 1, 1)), seed, metres=0.03, radians=0.2)
    return SimulatedTrials(np.full(n, name), error, holds(error))
