"""A forecaster with views, trained on static scenes in which errors lie along the viewing ray."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

import graspcast
from graspcast.bop.models import Models
from graspcast.bop.results import Results
from graspcast.errors import TrainingDataWarning
from graspcast.estimates.alignment import align
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.training_data import TrainingData
from graspcast.forecasting.view_data import view_data
from graspcast.pose.transforms import compose, invert
from graspcast.views.camera_motion import CameraMotion
from graspcast.views.fused_estimates import FusedEstimates, fuse_estimates
from poses import write_models
from static_scenes import estimates_of, objects, orbit, scattered, seen

NAMES = ("a", "b", "c")
CAMERAS = orbit(5, degrees=35.0)
SCENES = 12


class Training(NamedTuple):
    data: TrainingData
    models: dict[str, Models]
    results: dict[str, Results]
    motion: CameraMotion


def joined(tables: list[Results]) -> Results:
    columns = ("scene_id", "im_id", "obj_id", "score", "cam_T_obj", "time_s", "line")
    return Results(*(np.concatenate([getattr(t, c) for t in tables]) for c in columns))


def training(folder: Path, *, names: Sequence[str] = NAMES) -> Training:
    """Objects d-1 and d-2 as seen by estimators; grasps succeed with errors below 8 mm."""
    models = {"d": Models(write_models(folder, obj_1={}, obj_2={}))}
    if tuple(names) not in _MADE:
        _MADE[tuple(names)] = _made(models, names)
    data, results, motion = _MADE[tuple(names)]
    return Training(data, models, results, motion)


# What one process has made, for all of its tests.
_MADE: dict[tuple[str, ...], tuple[TrainingData, dict[str, Results], CameraMotion]] = {}


def _made(
    models: dict[str, Models], names: Sequence[str]
) -> tuple[TrainingData, dict[str, Results], CameraMotion]:
    truth = []
    tables: dict[str, list[Results]] = {name: [] for name in names}
    for scene in range(1, SCENES + 1):
        poses = seen(CAMERAS, objects(2, scene))
        truth.append(poses)
        for k, name in enumerate(names):
            found = scattered(poses, 10 * scene + k)
            tables[name].append(estimates_of(found, scene_id=scene))
    results = {name: joined(some) for name, some in tables.items()}
    estimates = align(results, dataset="d", anchor="a")
    place = estimates.scene_id - 1, estimates.im_id, estimates.obj_id - 1
    true = np.stack(truth)[place]
    error = compose(invert(true)[None], estimates.cam_T_obj)[..., :3, 3]
    success = (np.linalg.norm(error, axis=-1) < 0.008).astype(float)
    data = TrainingData(estimates, "a", "parallel", true, success)
    keys = [(s, i) for s in range(1, SCENES + 1) for i in range(len(CAMERAS))]
    scenes, images = zip(*keys, strict=True)
    motion = CameraMotion.of(scenes, images, np.concatenate([CAMERAS] * SCENES))
    views = view_data(estimates, [fused(results, models, motion, n) for n in (1, 2, 3)], {})
    return replace(data, views=views), results, motion


def fused(
    results: dict[str, Results], models: dict[str, Models], motion: CameraMotion, most: int = 3
) -> FusedEstimates:
    how = {"dataset": "d", "models": models, "views_from": "all", "max_views": most}
    return fuse_estimates(results, motion, **how)  # type: ignore[arg-type]


def trained(
    folder: Path, *, views: bool = True, names: Sequence[str] = NAMES
) -> tuple[graspcast.Forecaster, dict[str, Models]]:
    """A forecaster of these objects by estimators."""
    given = training(folder, names=names)
    if (views, *names) not in _TRAINED:
        data = given.data if views else replace(given.data, views=None)
        settings = ForestSettings(trees=8, folds=0)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            made = graspcast.train_forecaster(data, models=given.models, forests=settings)
        _TRAINED[views, *names] = made, [str(warning.message) for warning in said]
    forecaster, messages = _TRAINED[views, *names]
    for message in messages:
        warnings.warn(message, TrainingDataWarning, stacklevel=2)
    return forecaster, given.models


_TRAINED: dict[tuple[bool | str, ...], tuple[graspcast.Forecaster, list[str]]] = {}
