"""A forecaster with views, trained on static scenes in which errors lie along the viewing ray."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import graspcast
from graspcast.bop.models import Models
from graspcast.bop.results import Results
from graspcast.estimates.alignment import align
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.training_data import TrainingData
from graspcast.forecasting.view_data import view_data
from graspcast.pose.transforms import compose, invert
from graspcast.views.camera_motion import CameraMotion
from graspcast.views.fused_estimates import fuse_estimates
from poses import write_models
from static_scenes import estimates_of, objects, orbit, scattered, seen

NAMES = ("a", "b", "c")
CAMERAS = orbit(5, degrees=35.0)
SCENES = 12


def joined(tables: list[Results]) -> Results:
    columns = ("scene_id", "im_id", "obj_id", "score", "cam_T_obj", "time_s", "line")
    return Results(*(np.concatenate([getattr(t, c) for t in tables]) for c in columns))


def trained(folder: Path, *, views: bool = True) -> tuple[graspcast.Forecaster, dict[str, Models]]:
    """A forecaster of objects d-1 and d-2 by a, b and c: grasps succeed with errors below 8 mm."""
    models = {"d": Models(write_models(folder, obj_1={}, obj_2={}))}
    truth, tables = [], {name: [] for name in NAMES}  # type: ignore[var-annotated]
    for scene in range(1, SCENES + 1):
        poses = seen(CAMERAS, objects(2, scene))
        truth.append(poses)
        for k, name in enumerate(NAMES):
            found = scattered(poses, 10 * scene + k)
            tables[name].append(estimates_of(found, scene_id=scene))
    results = {name: joined(some) for name, some in tables.items()}
    estimates = align(results, dataset="d", anchor="a")
    place = estimates.scene_id - 1, estimates.im_id, estimates.obj_id - 1
    true = np.stack(truth)[place]
    error = compose(invert(true)[None], estimates.cam_T_obj)[..., :3, 3]
    success = (np.linalg.norm(error, axis=-1) < 0.008).astype(float)
    data = TrainingData(estimates, "a", "parallel", true, success)
    if views:
        keys = [(s, i) for s in range(1, SCENES + 1) for i in range(len(CAMERAS))]
        cameras = np.concatenate([CAMERAS] * SCENES)
        motion = CameraMotion.of(*zip(*keys, strict=True), cameras)  # type: ignore[call-arg,arg-type]
        parts = [
            fuse_estimates(
                results,
                motion,
                dataset="d",
                models=models,
                views_from="all",
                max_views=most,
            )
            for most in (1, 2, 3)
        ]
        data = replace(data, views=view_data(estimates, parts, {}))
    settings = ForestSettings(trees=20, folds=0)
    return graspcast.train_forecaster(data, models=models, forests=settings), models
