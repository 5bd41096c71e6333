"""A benchmark of static scenes with several views, from the world of :mod:`looked_at`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl

from graspcast.evaluation.benchmark import Benchmark
from graspcast.evaluation.view_fusion import Sources
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.views.object_motion import ObjectMotion
from looked_at import training

SMALL = ForestSettings(trees=6, draws=16, folds=2)


def benchmark(folder: Path, *, grippers: tuple[str, ...] = ("p",)) -> tuple[Benchmark, Sources]:
    """Instances with outcomes of every estimator, and what fused poses are made from."""
    data, models, results, motion = training(folder)
    keys = data.estimates.instances.frame()
    trials = [
        keys.with_columns(
            estimator=pl.lit(name),
            gripper=pl.lit(gripper),
            success=pl.Series(data.success[k].astype(np.int64)),
        )
        for k, name in enumerate(data.estimates.estimators)
        for gripper in grippers
    ]
    outcomes = pl.concat(trials)
    found = Benchmark(
        estimates=data.estimates,
        truth=data.truth,
        outcomes=outcomes,
        split=outcomes.rename({"estimator": "principal"}).with_columns(split=pl.lit("train")),
        models=models,
        reported=np.ones(len(data.estimates), dtype=bool),
    )
    estimated = ObjectMotion.from_estimates(results, dataset="d", models=models)
    return found, Sources({"d": results}, {"d": motion}, {"d": estimated}, models)
