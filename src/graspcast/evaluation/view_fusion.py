"""Fusion of the published estimates for every row of the tables with several views."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.bop.results import Results, read_results
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.instances import split_object_name
from graspcast.evaluation.view_motions import DisturbedMotion, OtherImagesMotion, ParallaxMotion
from graspcast.evaluation.view_sets import BenchmarkViews, ViewModelRule, ViewRow, ViewSet
from graspcast.forecasting.view_data import TRAINING_VIEWS, ViewData, view_data
from graspcast.io.progress import Progress, step_of
from graspcast.paper.dataset import DATASETS, ESTIMATORS, OBJECTS, Published
from graspcast.views.camera_motion import CameraNoise
from graspcast.views.camera_tables import read_camera_motion
from graspcast.views.choice import MIN_PARALLAX_RAD
from graspcast.views.fused_estimates import FusedEstimates, fuse_estimates
from graspcast.views.motion import Motion
from graspcast.views.object_motion import ObjectMotion

__all__ = ["Sources", "fuse_benchmark", "published_sources"]


@dataclass(frozen=True, eq=False)
class Sources:
    """What fused poses are made from.

    Attributes
    ----------
    results
        Dataset's name to the estimators' results, of the objects with outcomes.
    motion
        Dataset's name to the motion of its camera.
    estimated
        The same, estimated from the estimates of other objects.
    models
        Dataset's name to its object models.
    seed
        Of the errors of disturbed motion.
    """

    results: Mapping[str, Mapping[str, Results]]
    motion: Mapping[str, Motion]
    estimated: Mapping[str, Motion]
    models: Mapping[str, Models]
    seed: int = 0
    _done: dict[tuple[str, ViewRow], FusedEstimates] = field(default_factory=dict, repr=False)

    def fused(self, row: ViewRow) -> list[FusedEstimates]:
        """Fuse the estimates of every dataset as one row of the table says; once."""
        out = []
        for dataset in self.results:
            key = (dataset, row.fusion)
            if key not in self._done:
                self._done[key] = self._fused(dataset, row)
            out.append(self._done[key])
        return out

    def _fused(self, dataset: str, row: ViewRow) -> FusedEstimates:
        results, rule = self.results[dataset], row.rule
        names = (rule.alone,) if rule.alone else tuple(results)
        noise = CameraNoise(rule.noise_mm / 1e3, float(np.deg2rad(0.1 * rule.noise_mm)))
        motion = (self.estimated if rule.estimated else self.motion)[dataset]
        if rule.noise_mm:
            motion = DisturbedMotion(motion, noise, self.seed)
        if row.other_images:
            motion = OtherImagesMotion(motion, self.seed)
        if row.parallax_deg is not None:
            low, high = np.deg2rad(row.parallax_deg).tolist()
            motion = ParallaxMotion(motion, _positions(results[names[0]]), low, high)
        return fuse_estimates(
            {name: results[name] for name in names},
            motion,
            dataset=dataset,
            models=self.models,
            noise=noise,
            views_from="earlier" if row.earlier else "all",
            max_views=row.views,
            min_parallax_rad=row.min_parallax_rad,
        )


def published_sources(data: Published, *, seed: int = 0) -> Sources:
    """Return the published estimates with the motion of the camera.

    YCB-V's is that of ``published/ycbv/camera_motion``. Where a dataset has none, it is taken from
    the annotated poses of the other objects that did not move: LM-O's were rearranged.
    """
    results, motion, estimated = {}, dict[str, Motion](), dict[str, Motion]()
    for name in DATASETS:
        tables = {e: read_results(data.results_path(e, name)) for e in ESTIMATORS}
        wanted = [split_object_name(o) for o in OBJECTS]
        numbers = [number for dataset, number in wanted if dataset == name]
        results[name] = {e: t.select(np.isin(t.obj_id, numbers)) for e, t in tables.items()}
        poses = data.files / name / "camera_motion"
        motion[name] = (
            read_camera_motion(poses)
            if poses.is_dir()
            else ObjectMotion.from_ground_truth(data.bop[name].ground_truth, data.models[name])
        )
        known = list(data.models[name].info)
        tables = {e: t.select(np.isin(t.obj_id, known)) for e, t in tables.items()}
        estimated[name] = ObjectMotion.from_estimates(tables, dataset=name, models=data.models)
    return Sources(results, motion, estimated, data.models, seed)


def fuse_benchmark(
    sources: Sources,
    estimates: Estimates,
    rows: Sequence[ViewRow],
    *,
    progress: Progress | None = None,
) -> BenchmarkViews:
    """Fuse the poses of all instances, for training by each rule and to forecast each row.

    Parameters
    ----------
    sources
        Estimates and motion.
    estimates
        The instances.
    rows
        Of the tables.
    progress
        Called with the share of the work that is done and a message.
    """
    rules = list(dict.fromkeys([ViewModelRule(), *(row.rule for row in rows)]))
    wanted = list(dict.fromkeys([*(row.fusion for row in rows), ViewRow("", 1)]))
    total = len(rules) + len(wanted)
    train, test = {}, {}
    for i, rule in enumerate(rules):
        step_of(progress, i, total)(0.0, "fusing for training")
        train[rule] = _training(sources, estimates, rule)
    for i, row in enumerate(wanted):
        step_of(progress, len(rules) + i, total)(0.0, "fusing to forecast")
        test[row] = ViewSet.of(estimates, sources.fused(row))
    return BenchmarkViews(train, test)


def _training(sources: Sources, estimates: Estimates, rule: ViewModelRule) -> ViewData:
    """Fuse for training, from as many views as :func:`fuse_for_training` does."""
    parts = [each for most in TRAINING_VIEWS for each in sources.fused(ViewRow("", most, rule))]
    rules = {
        "noise_m": rule.noise_mm / 1e3,
        "noise_rad": float(np.deg2rad(0.1 * rule.noise_mm)),
        "min_parallax_rad": MIN_PARALLAX_RAD,
    }
    names = (rule.alone,) if rule.alone else estimates.estimators
    return view_data(estimates.only(*names), parts, rules)


def _positions(results: Results) -> dict[tuple[int, int, int], ndarray]:
    """Return the position of each object in each image, of the best estimate."""
    keys = np.stack([results.scene_id, results.im_id, results.obj_id], axis=1).tolist()
    order = np.argsort(results.score, kind="stable").tolist()
    return {tuple(keys[i]): results.cam_T_obj[i, :3, 3] for i in order}
