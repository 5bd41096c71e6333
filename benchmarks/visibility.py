"""How well one estimator's single view forecasts success, with and without the image.

    python benchmarks/visibility.py --data DIR --json visibility.json

The photographs of LM-O (200 images of one scene) in five contiguous blocks of frames: each block is
forecast by models trained on the other four. AUROC over all instances, and within objects (the mean
over objects, weighted by their instances), each the mean over three estimators and two grippers;
95 % intervals by drawing 40 blocks of five images, paired for differences.

The smallest leaf of the visibility model is chosen on the training blocks alone, by the Brier score
of out-of-fold predictions; the defaults are shown beside it.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy import ndarray
from sklearn.ensemble import ExtraTreesClassifier

from graspcast.bop.dataset import BopDataset
from graspcast.estimates.instances import scene_groups, unit_names
from graspcast.estimates.matching import true_poses
from graspcast.evaluation.bootstrap import Interval, ResampledScores, original_and_draws
from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.scores import calibration_error
from graspcast.forecasting.features import Features, consensus_features
from graspcast.forecasting.models.calibration import expit, logit
from graspcast.forecasting.models.encoding import one_hot_numbers
from graspcast.forecasting.models.visibility import Visibility
from graspcast.forecasting.models.visibility_settings import VisibilitySettings
from graspcast.forecasting.train import fit_forecaster
from graspcast.forecasting.training_data import TrainingData
from graspcast.forecasting.visibility_features import visibility_features
from graspcast.io.markdown import table
from graspcast.paper.dataset import GRIPPERS, Published
from graspcast.rendering.image_fit import fit_of_instances

DATASET = "lmo"
LEAVES = (2, 3, 5, 8)
DRAWS = 1000
Pair = tuple[str, str]
Found = tuple[dict[str, ndarray], ndarray]
"""Forecasts by method, and outcomes."""
BASE, IMAGE, BLEND = "own pose and score", "own pose, score and image fit", "consensus (blend)"
TREES, TREES_IMAGE = "trees on the consensus", "trees on the consensus and image fit"
MIXED = "blend and visibility averaged"


class Data:
    """The photographs' instances, with scores and image fit of each estimator."""

    def __init__(self, directory: Path):
        published = Published(directory)
        every = published.estimates
        self.estimates = every.select(every.dataset == DATASET)
        self.outcomes, self.models = published.outcomes, published.models
        self.truth = true_poses(self.estimates, self.estimates.estimators[0], published.bop)
        self.blocks = scene_groups(self.estimates.instances)
        self.units = scene_groups(self.estimates.instances, blocks=40)
        self.images = unit_names(self.estimates.instances, "image")
        names = sorted(set(self.estimates.objects.tolist()))
        self.numbers = np.searchsorted(names, self.estimates.objects)
        self.objects = len(names)
        photographs = {DATASET: BopDataset(directory / "bop" / DATASET, name=DATASET)}
        self.rows: dict[str, Features] = {}
        for name in self.estimates.estimators:
            start = perf_counter()
            poses = self.estimates.of(name)
            fit = fit_of_instances(self.estimates.instances, poses, photographs)
            took = (perf_counter() - start) / len(poses) * 1e3
            lacking = sum(map(bool, fit.problems))
            print(f"{name}: image fit {took:.1f} ms an instance, {lacking} without", flush=True)
            score = self.estimates.seen["score"][self.estimates.index(name)]
            self.rows[name] = visibility_features(poses, score, fit.features)


def without_image(rows: Features) -> Features:
    return Features(rows.names[:7], rows.values[:, :7])


def visible(
    data: Data, rows: Features, success: ndarray, train: ndarray, settings: VisibilitySettings
) -> Visibility:
    return Visibility.fit(
        Features(rows.names, rows.values[train]),
        success[train],
        data.numbers[train],
        data.blocks[train],
        data.images[train],
        objects=data.objects,
        settings=settings,
    )


def chosen(data: Data, rows: Features, success: ndarray, train: ndarray) -> int:
    """Choose the smallest leaf by out-of-fold predictions of the training blocks."""
    brier = []
    for leaf in LEAVES:
        settings = VisibilitySettings(trees=64, min_samples_leaf=leaf)
        kept = visible(data, rows, success, train, settings).out_of_fold
        assert kept is not None
        brier.append(float(((kept.probability - kept.success) ** 2).mean()))
    return LEAVES[int(np.argmin(brier))]


def trees(columns: ndarray, data: Data, success: ndarray, train: ndarray, test: ndarray) -> ndarray:
    which = one_hot_numbers(data.numbers, data.objects)
    inputs = np.concatenate([np.nan_to_num(columns, nan=-1.0), which], axis=1)
    model = ExtraTreesClassifier(
        200, min_samples_leaf=2, max_features=0.5, random_state=0, n_jobs=-1
    ).fit(inputs[train], success[train] == 1)
    return np.asarray(model.predict_proba(inputs[test])[:, 1])


def forecasts_of(data: Data, principal: str, gripper: str) -> Found:
    """Return every method's forecasts (NaN where not tried), and the outcomes."""
    joined = TrainingData.join(data.estimates, data.outcomes, principal, gripper, truth=data.truth)
    success = joined.own_success
    tried, rows = ~np.isnan(success), data.rows[principal]
    consensus = consensus_features(
        data.estimates, principal, which="full", models=data.models
    ).values
    out: dict[str, ndarray] = {}
    for block in np.unique(data.blocks):
        train, test = tried & (data.blocks != block), tried & (data.blocks == block)
        found = {}
        rates = [
            (success[train & (data.numbers == k)].sum() + 1)
            / ((train & (data.numbers == k)).sum() + 2)
            for k in range(data.objects)
        ]
        found["object alone"] = np.array(rates)[data.numbers[test]]
        pose = Features(rows.names[:7], rows.values[:, :7].copy())
        pose.values[:, 6] = np.nan
        for name, given in (
            ("own pose", pose), (BASE, without_image(rows)), (IMAGE, rows),
        ):  # fmt: skip
            asked = (given.values[test], data.numbers[test])
            default = visible(data, given, success, train, VisibilitySettings())
            found[name] = default.probability(*asked)
            if name == IMAGE:
                text = "the same, asked without images"
                found[text] = default.probability(asked[0][:, :7], asked[1])
            if name in (BASE, IMAGE):
                leaf = chosen(data, given, success, train)
                settings = VisibilitySettings(min_samples_leaf=leaf)
                other = visible(data, given, success, train, settings)
                found[f"{name}, leaf chosen"] = other.probability(*asked)
        blend = fit_forecaster(joined.select(data.blocks != block), models=data.models)
        asked_blend = data.estimates.select(test)
        found[BLEND] = blend.probability(asked_blend, data.models)
        mixed = (logit(found[BLEND]) + logit(found[IMAGE])) / 2
        found[MIXED] = expit(mixed)
        found[TREES] = trees(consensus, data, success, train, test)
        both = np.concatenate([consensus, rows.values[:, 7:]], axis=1)
        found[TREES_IMAGE] = trees(both, data, success, train, test)
        for name, values in found.items():
            out.setdefault(name, np.full(len(success), np.nan))[test] = values
    return out, success


class Scored:
    """AUROC of a method on the original data and on draws, over all and within objects."""

    def __init__(self, every: dict[Pair, Found], data: Data):
        self.every, self.data = every, data
        self.scenes = sorted(set(data.units.tolist()))
        self.draws = original_and_draws(self.scenes, DRAWS, 0)

    def _auroc(self, p: ndarray, success: ndarray, rows: ndarray) -> ndarray:
        names = self.data.estimates.objects[rows]
        given = Forecasts("", "", "", "", p[rows], success[rows] == 1, names, self.data.units[rows])
        return np.asarray(ResampledScores(given, self.scenes, self.draws).auroc())

    def pooled(self, method: str) -> ndarray:
        """Return the mean over estimators and grippers, (draws + 1,)."""
        each = [self._auroc(f[method], y, ~np.isnan(f[method])) for f, y in self.every.values()]
        return np.asarray(np.mean(each, axis=0))

    def within(self, method: str) -> ndarray:
        each = []
        for found, success in self.every.values():
            parts, sizes = [], []
            for number in range(self.data.objects):
                mine = ~np.isnan(found[method]) & (self.data.numbers == number)
                if len(np.unique(success[mine])) == 2:
                    parts.append(self._auroc(found[method], success, mine))
                    sizes.append(mine.sum())
            stacked, weight = np.array(parts), np.array(sizes)[:, None]
            known = np.isfinite(stacked)  # a draw may lack one outcome of an object
            each.append((np.nan_to_num(stacked) * weight).sum(0) / (known * weight).sum(0))
        return np.asarray(np.mean(each, axis=0))

    def ece(self, method: str) -> float:
        pairs = [(f[method][~np.isnan(f[method])], y[~np.isnan(f[method])] == 1)
                 for f, y in self.every.values()]  # fmt: skip
        return float(np.mean([calibration_error(p, y) for p, y in pairs]))

    def accuracy(self, method: str) -> float:
        return float(np.mean([((f[method] >= 0.5) == (y == 1))[~np.isnan(f[method])].mean()
                              for f, y in self.every.values()]))  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="holds published/ and bop/")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    data = Data(options.data)
    every: dict[Pair, Found] = {}
    for principal in data.estimates.estimators:
        for gripper in GRIPPERS:
            start = perf_counter()
            every[principal, gripper] = forecasts_of(data, principal, gripper)
            print(f"{principal}, {gripper}: {perf_counter() - start:.0f} s", flush=True)
    scored = Scored(every, data)
    methods = list(next(iter(every.values()))[0])
    pooled = {name: scored.pooled(name) for name in methods}
    within = {name: scored.within(name) for name in methods}
    rows = []
    for name in methods:
        cells = [str(Interval.of(d[name][0], d[name][1:])) for d in (pooled, within)]
        rows.append([name, *cells, f"{scored.accuracy(name):.3f}", f"{scored.ece(name):.3f}"])
    print(table(["forecast from", "AUROC", "within objects", "accuracy", "ECE"], rows))
    compared = [
        (IMAGE, BASE), (BASE, "object alone"), (BLEND, IMAGE), (MIXED, BLEND), (TREES_IMAGE, TREES),
    ]  # fmt: skip
    rows = []
    for better, worse in compared:
        cells = []
        for drawn in (pooled, within):
            difference = drawn[better] - drawn[worse]
            cells.append(f"{Interval.of(difference[0], difference[1:]):+}")
        rows.append([f"{better} less {worse}", *cells])
    print(table(["difference", "AUROC", "within objects"], rows))
    single = {pair: Scored({pair: found}, data) for pair, found in every.items()}
    rows = [[", ".join(pair), *(f"{one.pooled(name)[0]:.3f}" for name in (BASE, IMAGE, BLEND))]
            for pair, one in single.items()]  # fmt: skip
    print(table(["estimator, gripper", BASE, IMAGE, BLEND], rows))
    if options.json:
        found = {n: {"auroc": float(pooled[n][0]), "within": float(within[n][0])} for n in methods}
        options.json.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
