"""What choosing among several grasps of an object is worth, on unseen scenes.

    graspcast simulate --lenient --bop … --ground-truth … --estimates … \
        --gripper parallel --grasps grasps.toml --out several
    python benchmarks/several_grasps.py --data DIR --outcomes several

The campaign has trials of several grasps of each object, the reference grasp among them, guided by
the published estimates. Scenes (and blocks of LM-O's frames) are dealt out to five folds. The
default forecaster learns from four of them, and on the instances of the fifth the same estimates
guide (always, without abstaining)

- the reference grasp,
- the grasp of the object that succeeded most often in training, one for all instances,
- the grasp with the highest forecast, chosen for each instance,
- and, what no forecaster can, any grasp that succeeds.

Where grasps are chosen the forecast's calibration is measured as well, with and without the
correction of highest forecasts, and so is what is attempted from a probability of 0.8 on. Intervals
are by a bootstrap over scenes; figures are means over all instances and the three estimators.

``--views 1 3`` forecasts from one view and from three, on those instances that have a second view.
Views serve as in the protocol ``several_views`` of ``graspcast evaluate``, and inform the forecast
alone: the estimate of the instance's own image guides the grasp, whatever the number of views. So
success without abstaining depends on them by the choice of the grasp alone. Where the views
contradict each other so that one is left, the forecast is that from one view.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.cli.options import write_json
from graspcast.estimates.instances import scene_groups
from graspcast.estimates.outcomes import read_all_outcomes
from graspcast.evaluation.benchmark import Benchmark
from graspcast.evaluation.bootstrap import Interval, original_and_draws
from graspcast.evaluation.scores import calibration_error
from graspcast.evaluation.view_fusion import fuse_benchmark, published_sources
from graspcast.evaluation.view_sets import ViewModelRule, ViewRow, ViewSet
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.grasp_ranking import GraspForecast
from graspcast.forecasting.models.blend import Blend, ForestSettings
from graspcast.forecasting.splits import by_group
from graspcast.forecasting.train import fit_forecaster
from graspcast.forecasting.training_data import TrainingData
from graspcast.forecasting.view_rankings import view_ranking
from graspcast.paper.dataset import Published

AT = 0.8
DRAWS = 2000
POLICIES = ("reference", "best fixed", "chosen", "any that succeeds")


@dataclass(frozen=True, eq=False)
class Held:
    """Held-out forecasts and outcomes of one estimator in one fold, n instances of S grasps.

    ``probability`` is of the chosen grasp; ``uncorrected``, ``of_reference`` and ``of_fixed`` are
    as if the chosen, the reference or the fixed grasp were the only one.
    """

    scenes: ndarray
    objects: ndarray
    success: Float[ndarray, "s n"]
    fixed: Int[ndarray, " n"]
    chosen: Int[ndarray, " n"]
    probability: Float[ndarray, " n"]
    uncorrected: Float[ndarray, " n"]
    of_reference: Float[ndarray, " n"]
    of_fixed: Float[ndarray, " n"]

    def outcome(self, which: Int[ndarray, " n"]) -> Float[ndarray, " n"]:
        """Return the outcome of one grasp of each instance."""
        return self.success[which, np.arange(len(which))]


def main() -> None:
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--data", type=Path, required=True)
    options.add_argument("--outcomes", type=Path, action="append", required=True)
    options.add_argument("--gripper", default="parallel")
    options.add_argument("--folds", type=int, default=5)
    options.add_argument("--trees", type=int, default=128)
    options.add_argument("--calibration-folds", type=int, default=4, help="inside training")
    options.add_argument("--views", type=int, nargs="+", default=[], help="at most, beside 1")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--json", type=Path)
    given = options.parse_args()

    benchmark = Benchmark.of(Published(given.data))
    outcomes = read_all_outcomes(given.outcomes)
    first = benchmark.estimates.estimators[0]
    data = TrainingData.join(
        benchmark.estimates, outcomes, first, given.gripper, truth=benchmark.truth
    )
    # Instances of which every grasp was tried, guided by every estimator.
    tried = ~np.isnan(data.every_success).all(axis=1)
    names = sorted(set(data.objects[tried.any(axis=0)].tolist()))
    whole = np.isin(data.objects, names)
    for s in range(len(data.grasps)):
        mine = np.isin(data.objects, data.objects[tried[s]])
        whole &= ~mine | ~np.isnan(data.every_success[s]).any(axis=0)
    data = data.select(whole)
    views_of = sorted({1, *given.views})
    data, fused = with_views(data, Published(given.data), views_of)
    settings = ForestSettings(trees=given.trees, folds=given.calibration_folds, seed=given.seed)
    started = perf_counter()
    held: dict[int, list[Held]] = {views: [] for views in views_of}
    for views, each in held_out(data, fused, benchmark, settings, given.folds):
        held[views].append(each)
    print(f"{len(data)} instances, {len(names)} objects, {perf_counter() - started:.0f} s")
    found: dict[str, dict[str, object]] = {}
    drawn = {views: draws_of(each, given.seed) for views, each in held.items()}
    for views, each in held.items():
        title = f"{views} view{'s' * (views > 1)}"
        found[title] = summary(each, drawn[views])
        if views > 1:
            found[f"{title} minus 1"] = {
                name: interval(draws - drawn[1][name]) for name, draws in drawn[views].items()
            }
    for title, figures in found.items():
        print(f"\n| {title} | |\n|---|---|")
        for name, value in figures.items():
            print(f"| {name} | {shown(value)} |")
    for views, each in held.items():
        print_objects(f"object, {views}", each, names)
    if given.json:
        write_json(given.json, found)


def print_objects(title: str, held: list[Held], names: Sequence[str]) -> None:
    """Print success of each object by policy."""
    print(f"\n| {title} | n | " + " | ".join(POLICIES) + " |")
    print("|---|---|" + "---|" * len(POLICIES))
    objects = np.concatenate([each.objects for each in held])
    for name in names:
        if not (mine := objects == name).any():  # in one scene alone
            continue
        rates = [f"{values[mine].mean():.3f}" for values in by_policy(held).values()]
        print(f"| {name} | {mine.sum()} | " + " | ".join(rates) + " |")


def with_views(
    data: TrainingData, published: Published, views: Sequence[int]
) -> tuple[TrainingData, dict[int, ViewSet]]:
    """Fuse for training, and to forecast from each number of views, where one is above 1."""
    rows = {v: ViewRow(f"{v} views", v) for v in views if v > 1}
    if not rows:
        return data, {}
    fused = fuse_benchmark(published_sources(published), data.estimates, list(rows.values()))
    found = {v: fused.test[row.fusion] for v, row in rows.items()}
    return replace(data, views=fused.train[ViewModelRule()]), found


def held_out(
    data: TrainingData,
    fused: Mapping[int, ViewSet],
    benchmark: Benchmark,
    settings: ForestSettings,
    folds: int,
) -> Iterator[tuple[int, Held]]:
    """Yield number of views, forecasts and outcomes of each fold and estimator."""
    groups = scene_groups(data.estimates.instances)
    places = {grasp: s for s, grasp in enumerate(data.grasps)}
    for train, test in by_group(groups, data.objects, folds=folds, seed=settings.seed):
        learned = data.select(train)
        forecaster = fit_forecaster(
            learned,
            guides=data.estimates.estimators,
            models=benchmark.models,
            forests=settings,
        )
        known = np.isin(data.objects[test], forecaster.card.objects)
        for found in fused.values():
            known &= np.isin(test, found.data.row)
        test = test[known]
        asked, best = data.select(test), best_fixed(learned)
        mine = {v: found.select(test, len(data)) for v, found in fused.items()}
        fixed = np.array([best[name] for name in asked.objects.tolist()], dtype=np.int64)
        for k, name in enumerate(data.estimates.estimators):
            guided = forecaster.guided_by(name)
            given = asked, name, mine, benchmark.models
            ranked, alone = rankings(guided, *given), rankings(uncorrected(guided), *given)
            able = np.flatnonzero([all(r[i] for r in ranked.values()) for i in range(len(test))])
            for views, best_first in ranked.items():
                each = [
                    {places[f.grasp]: f.probability for f in alone[views][i]} for i in able.tolist()
                ]
                chosen = [places[best_first[i][0].grasp] for i in able.tolist()]
                which = zip(each, chosen, fixed[able].tolist(), strict=True)
                p = [(of[c], of[0], of[f]) for of, c, f in which]
                yield (
                    views,
                    Held(
                        groups[test][able],
                        asked.objects[able],
                        asked.every_success[:, k, able],
                        fixed[able],
                        np.array(chosen),
                        np.array([best_first[i][0].probability for i in able.tolist()]),
                        *np.array(p).T,
                    ),
                )


def rankings(
    forecaster: Forecaster,
    asked: TrainingData,
    guide: str,
    fused: Mapping[int, ViewSet],
    models: Mapping[str, Models],
) -> dict[int, list[tuple[GraspForecast, ...]]]:
    """Rank the grasps of instances from one view, and from each number of views."""
    out = {1: list(forecaster.rank(asked.estimates, models))}
    for views, found in fused.items():
        data, several = found.data, found.data.views > 1
        row = data.row[several]
        ranking = view_ranking(
            forecaster,
            asked.estimates.instances.select(row),
            data.statistics[several],
            data.cam_T_fused[several],
            asked.estimates.of(guide)[row],
            models,
        )
        out[views] = list(out[1])
        for i, grasps in zip(row.tolist(), ranking.grasps, strict=True):
            out[views][i] = grasps
    return out


def best_fixed(data: TrainingData) -> dict[str, int]:
    """Return for each object the place of the grasp that succeeded most often."""
    out = {}
    for name in sorted(set(data.objects.tolist())):
        own = data.every_success[:, :, data.objects == name].reshape(len(data.grasps), -1)
        rate = np.nanmean(np.where(np.isnan(own).all(axis=1)[:, None], -1.0, own), axis=1)
        out[name] = int(rate.argmax())
    return out


def uncorrected(forecaster: Forecaster) -> Forecaster:
    """Return a forecaster without the correction of highest forecasts."""
    assert isinstance(forecaster.predictor, Blend)
    views = forecaster.predictor.views
    views = None if views is None else replace(views, choice=None)
    return replace(forecaster, predictor=replace(forecaster.predictor, choice=None, views=views))


def by_policy(held: list[Held]) -> dict[str, Float[ndarray, " n"]]:
    """Return the outcomes of always attempting by each policy."""
    each_of = [
        (each.success[0], each.outcome(each.fixed), each.outcome(each.chosen)) for each in held
    ]
    perfect = np.concatenate([np.nanmax(each.success, axis=0) for each in held])
    found = [*(np.concatenate(parts) for parts in zip(*each_of, strict=True)), perfect]
    return dict(zip(POLICIES, found, strict=True))


def joined(held: list[Held], of: str) -> ndarray:
    """Return one thing of all folds and estimators."""
    return np.concatenate([getattr(each, of) for each in held])


def draws_of(held: list[Held], seed: int) -> dict[str, Float[ndarray, " d"]]:
    """Return rates by policy and their differences, of all scenes and of each draw of scenes."""
    scene, number = np.unique(joined(held, "scenes"), return_inverse=True)
    counts = original_and_draws(scene.tolist(), DRAWS, seed)

    def mean(values: ndarray, among: Bool[ndarray, " n"] | None = None) -> Float[ndarray, " d"]:
        weight = np.ones(len(values)) if among is None else among.astype(np.float64)
        sums = [
            np.bincount(number, weights=w, minlength=len(scene)) for w in (values * weight, weight)
        ]
        return np.asarray((counts @ sums[0]) / (counts @ sums[1]))

    outcomes = by_policy(held)
    rates = {name: mean(values) for name, values in outcomes.items()}
    out = {f"success, {name}": draws for name, draws in rates.items()}
    out["chosen minus reference"] = rates["chosen"] - rates["reference"]
    out["best fixed minus reference"] = rates["best fixed"] - rates["reference"]
    out["chosen minus best fixed"] = rates["chosen"] - rates["best fixed"]
    for name in ("probability", "uncorrected"):
        label = "corrected" if name == "probability" else name
        p = joined(held, name)
        out[f"{label}: forecast minus success"] = mean(p - outcomes["chosen"])
        out[f"{label}: Brier score"] = mean((p - outcomes["chosen"]) ** 2)
    for policy, of in zip(POLICIES, ("of_reference", "of_fixed", "probability"), strict=False):
        tried = joined(held, of) >= AT
        out[f"attempted from {AT}, {policy}"] = mean(tried.astype(float))
        out[f"success of these, {policy}"] = mean(outcomes[policy], tried)
        out[f"attempted with success, {policy}"] = mean(tried * outcomes[policy])
    return out


def summary(held: list[Held], drawn: Mapping[str, Float[ndarray, " d"]]) -> dict[str, object]:
    """Return success by policy, differences and calibration, with intervals."""
    scenes = joined(held, "scenes")
    out: dict[str, object] = {"n": len(scenes), "scenes": len(np.unique(scenes))}
    out |= {name: interval(draws) for name, draws in drawn.items()}
    held_chosen = by_policy(held)["chosen"]
    for name in ("probability", "uncorrected"):
        p = joined(held, name)
        label = "corrected" if name == "probability" else name
        out[f"{label}: mean forecast of the chosen"] = float(p.mean())
        out[f"{label}: calibration error"] = calibration_error(p, held_chosen == 1)
    return out


def interval(draws: Float[ndarray, " d"]) -> dict[str, float]:
    """Return a figure with its interval."""
    found = Interval.of(float(draws[0]), draws[1:])
    return {"value": found.value, "low": found.low, "high": found.high}


def shown(value: object) -> str:
    """Return a figure as text."""
    if isinstance(value, dict):
        return f"{value['value']:.3f} [{value['low']:.3f}, {value['high']:.3f}]"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
