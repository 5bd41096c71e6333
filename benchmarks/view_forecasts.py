"""Forecasts with several views on the published data, on scenes that are not in training.

Grasps are guided by single-view estimates, whose outcomes are published. For each fold of scenes
one model is trained (on fusions from 1, 2, 3 and 5 views of training scenes), and answers for every
guide and every choice of views. Compared on the same instances with the forecast from one view.
YCB-V's camera motion is that of its annotation; LM-O's objects were rearranged between frames, so
its views count where two other objects moved rigidly with the judged one.

    python benchmarks/view_forecasts.py --data DATA --json view_forecasts.json
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from fusion import noisy
from graspcast.bop.results import Results, read_results
from graspcast.estimates.alignment import Estimates
from graspcast.evaluation.benchmark import Benchmark
from graspcast.evaluation.bootstrap import Bootstrap
from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.protocols import tasks
from graspcast.evaluation.report import evaluate
from graspcast.forecasting.models.blend import Blend, ForestSettings
from graspcast.forecasting.models.design_matrix import DesignMatrix, ViewMatrix
from graspcast.forecasting.models.growing import grow_blends
from graspcast.forecasting.training_data import TrainingData
from graspcast.forecasting.view_data import TRAINING_VIEWS, ViewData, view_data
from graspcast.io.json import write_json
from graspcast.io.markdown import table as markdown_table
from graspcast.paper.dataset import DATASETS, ESTIMATORS, OBJECTS, Published
from graspcast.views.camera_motion import CameraNoise
from graspcast.views.camera_tables import read_camera_motion
from graspcast.views.fused_estimates import FusedEstimates, fuse_estimates
from graspcast.views.motion import Motion
from graspcast.views.object_motion import ObjectMotion

MEASURES = ("accuracy", "auroc", "ece", "brier")
NOISES = {"1 mm, 0.1 deg": 1, "3 mm, 0.3 deg": 3, "5 mm, 0.5 deg": 5}


@dataclass(frozen=True, eq=False)
class World:
    data: Published
    benchmark: Benchmark
    results: Mapping[str, Mapping[str, Results]]
    motions: Mapping[str, Motion]

    @classmethod
    def of(cls, directory: Path) -> World:
        data = Published(directory)
        results = {
            dataset: {e: read_results(data.results_path(e, dataset)) for e in ESTIMATORS}
            for dataset in DATASETS
        }
        for dataset, tables in results.items():
            wanted = [int(name.split("-")[1]) for name in OBJECTS if name.startswith(dataset)]
            for name, table in tables.items():
                results[dataset][name] = table.select(np.isin(table.obj_id, wanted))
        lmo = data.bop["lmo"]
        motions: dict[str, Motion] = {
            "ycbv": read_camera_motion(data.files / "ycbv" / "camera_motion"),
            "lmo": ObjectMotion.from_ground_truth(lmo.ground_truth, lmo.models),
        }
        return cls(data, Benchmark.of(data), results, motions)

    def fused(
        self,
        most: int,
        names: tuple[str, ...] = ESTIMATORS,
        *,
        views_from: Any = "all",
        noise: CameraNoise | None = None,
        motions: Mapping[str, Motion] | None = None,
    ) -> list[FusedEstimates]:
        return [
            fuse_estimates(
                {name: tables[name] for name in names},
                (motions or self.motions).get(dataset) if most > 1 else None,
                dataset=dataset,
                principal=names[0],
                models=self.data.models,
                noise=noise,
                views_from=views_from,
                max_views=most,
            )
            for dataset, tables in self.results.items()
        ]

    def training_data(self, gripper: str, names: tuple[str, ...]) -> TrainingData:
        """All instances, with the outcomes of every guide."""
        estimates: Estimates = self.benchmark.estimates.only(*names)
        success = np.full((len(names), len(estimates)), np.nan)
        every = np.ones(len(estimates), dtype=bool)
        for k, name in enumerate(names):
            tried = self.benchmark.tried(name, gripper, every)
            success[k, self.benchmark.rows_of(tried.estimates)] = tried.own_success
        return TrainingData(estimates, names[0], gripper, self.benchmark.truth, success)


def joined(world: World, data: TrainingData, *parts: list[FusedEstimates]) -> ViewData:
    return view_data(data.estimates, [one for part in parts for one in part], {})


def forecasts_of(
    world: World,
    gripper: str,
    names: tuple[str, ...],
    training: ViewData,
    asked: Mapping[str, ViewData],
    seed: int,
) -> list[Forecasts]:
    """Forecast every asked choice of views by models trained without the scene."""
    data = replace(world.training_data(gripper, names), views=training)
    tests = {name: ViewMatrix.of(data, views, world.data.models) for name, views in asked.items()}
    objects = tuple(sorted(set(data.objects.tolist())))
    singles = np.full(data.success.shape, np.nan)
    several = {name: np.full((len(names), len(data)), np.nan) for name in tests}
    matrix = DesignMatrix.of(replace(data, views=None), objects, world.data.models)
    for test in _folds(world, gripper, seed):
        blends = grow_blends(
            data.select(~test), names, objects, world.data.models, ForestSettings(seed=seed)
        )
        for k, guide in enumerate(names):
            blend: Blend = blends[guide]
            rows = np.flatnonzero(test & blend.known[matrix.numbers])
            if len(names) > 1:
                singles[k, rows] = blend.probability(matrix.features[k, rows], matrix.numbers[rows])
            for name, seen in tests.items():
                mine = np.flatnonzero(np.isin(seen.row, rows) & (seen.views > 1))
                several[name][k, seen.row[mine]] = blend.view_probability(
                    seen.statistics[mine],
                    seen.fused[k, mine],
                    seen.guide[k, mine],
                    matrix.numbers[seen.row[mine]],
                )
    out = []
    for name, found in several.items():
        for k, guide in enumerate(names):
            given = {f"{name}": found[k]}
            if len(names) > 1:
                given["blend, one view"] = singles[k]
            out += _columns(world, data, name, guide, gripper, data.success[k], given)
    return out


def _folds(world: World, gripper: str, seed: int) -> list[ndarray]:
    """The folds of the protocol unseen_scenes, as rows of the benchmark."""
    out = []
    for _, test in tasks(world.benchmark, "unseen_scenes", ESTIMATORS[0], gripper, seed=seed):
        scenes = np.unique(world.benchmark.scenes[world.benchmark.rows_of(test.estimates)])
        out.append(np.isin(world.benchmark.scenes, scenes))
    return out


def _columns(
    world: World,
    data: TrainingData,
    protocol: str,
    guide: str,
    gripper: str,
    success: ndarray,
    given: Mapping[str, ndarray],
) -> list[Forecasts]:
    """The forecasts of a guide where all of them are there."""
    known = ~np.isnan(success)
    for values in given.values():
        known &= ~np.isnan(values)
    rows = np.flatnonzero(known)
    return [
        Forecasts(
            protocol,
            method,
            guide,
            gripper,
            values[rows],
            success[rows] == 1,
            data.objects[rows],
            world.benchmark.scenes[rows],
        )
        for method, values in given.items()
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--grippers", nargs="+", default=["parallel", "underactuated"])
    parser.add_argument("--without", nargs="+", default=[], help="noise, alone or estimated")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--bootstrap", type=int, default=1000)
    options = parser.parse_args()
    began = time.perf_counter()
    world = World.of(options.data)
    forecasts: list[Forecasts] = []
    for gripper in options.grippers:
        forecasts += run(world, gripper, options.without, options.seed)
        print(f"{gripper}: {time.perf_counter() - began:.0f} s", flush=True)
    found = evaluate(forecasts, bootstrap=Bootstrap(options.bootstrap, options.seed))["evaluate"]
    print(table(found, options.grippers))
    if options.json:
        content = {
            "evaluate": found,
            "n": {f"{f.protocol}, {f.principal}, {f.gripper}": len(f) for f in forecasts},
        }
        write_json(options.json, content)


def run(world: World, gripper: str, without: list[str], seed: int) -> list[Forecasts]:
    whole = world.training_data(gripper, ESTIMATORS)
    parts = {most: world.fused(most) for most in TRAINING_VIEWS}
    training = joined(world, whole, *parts.values())
    asked = {f"{n} views": joined(world, whole, parts[n]) for n in (2, 3, 5)}
    asked["3 views, earlier"] = joined(world, whole, world.fused(3, views_from="earlier"))
    if "estimated" not in without:
        motions = {
            name: ObjectMotion.from_estimates(tables, dataset=name, models=world.data.models)
            for name, tables in world.results.items()
        }
        asked["3 views, motion estimated"] = joined(world, whole, world.fused(3, motions=motions))
    out = forecasts_of(world, gripper, ESTIMATORS, training, asked, seed)
    for name, size in NOISES.items() if "noise" not in without else ():
        noise = CameraNoise(size / 1000, float(np.deg2rad(size / 10)))
        # LM-O's motion is no table of camera poses; only YCB-V's is displaced.
        motions = {"ycbv": noisy(world.motions["ycbv"], noise, seed)}  # type: ignore[arg-type]
        noised = [world.fused(n, noise=noise, motions=motions) for n in TRAINING_VIEWS]
        seen = {f"3 views, {name}, YCB-V": joined(world, whole, noised[TRAINING_VIEWS.index(3)])}
        out += forecasts_of(world, gripper, ESTIMATORS, joined(world, whole, *noised), seen, seed)
    for name in ESTIMATORS if "alone" not in without else ():
        alone = world.training_data(gripper, (name,))
        mine = {n: world.fused(n, (name,)) for n in TRAINING_VIEWS}
        seen = {f"one estimator, {n} views": joined(world, alone, mine[n]) for n in (2, 3)}
        training = joined(world, alone, *mine.values())
        out += forecasts_of(world, gripper, (name,), training, seen, seed)
    return out


def table(found: Mapping[str, Any], grippers: list[str]) -> str:
    rows = []
    for protocol, methods in found.items():
        for method, by_gripper in methods.items():
            cells = [protocol if method != protocol else f"**{method}**"]
            cells[0] += "" if method == protocol else ": the same instances from one view"
            for measure in MEASURES:
                values = []
                for gripper in grippers:
                    low, high = by_gripper[gripper][f"{measure}_interval"]
                    values.append(f"{by_gripper[gripper][measure]:.3f} [{low:.3f}, {high:.3f}]")
                cells.append(" / ".join(values))
            rows.append(cells)
    return markdown_table(["forecast", *MEASURES], rows)


if __name__ == "__main__":
    main()
