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
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.cli.options import write_json
from graspcast.estimates.instances import scene_groups
from graspcast.estimates.outcomes import read_all_outcomes
from graspcast.evaluation.benchmark import Benchmark
from graspcast.evaluation.bootstrap import Interval, original_and_draws
from graspcast.evaluation.scores import calibration_error
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.models.blend import Blend, ForestSettings
from graspcast.forecasting.splits import by_group
from graspcast.forecasting.train import fit_forecaster
from graspcast.forecasting.training_data import TrainingData
from graspcast.paper.dataset import Published

AT = 0.8
DRAWS = 2000
POLICIES = ("reference", "best fixed", "chosen", "any that succeeds")


@dataclass(frozen=True, eq=False)
class Held:
    """Held-out forecasts and outcomes of one estimator in one fold, n instances of S grasps."""

    scenes: ndarray
    objects: ndarray
    success: Float[ndarray, "s n"]
    fixed: Int[ndarray, " n"]
    chosen: Int[ndarray, " n"]
    probability: Float[ndarray, " n"]
    uncorrected: Float[ndarray, " n"]
    reference: Float[ndarray, " n"]

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
    settings = ForestSettings(trees=given.trees, folds=given.calibration_folds, seed=given.seed)
    started = perf_counter()
    held = list(held_out(data, benchmark, settings, given.folds))
    print(f"{len(data)} instances, {len(names)} objects, {perf_counter() - started:.0f} s")
    found = summary(held, given.seed)
    for name, value in found.items():
        print(f"| {name} | {shown(value)} |")
    print("\n| object | n | " + " | ".join(POLICIES) + " |\n|---|---|" + "---|" * len(POLICIES))
    objects = np.concatenate([each.objects for each in held])
    for name in names:
        if not (mine := objects == name).any():  # in one scene alone
            continue
        rates = [f"{values[mine].mean():.3f}" for values in by_policy(held).values()]
        print(f"| {name} | {mine.sum()} | " + " | ".join(rates) + " |")
    if given.json:
        write_json(given.json, found)


def held_out(
    data: TrainingData, benchmark: Benchmark, settings: ForestSettings, folds: int
) -> Iterator[Held]:
    """Yield forecasts and outcomes of each fold and estimator."""
    groups = scene_groups(data.estimates.instances)
    for train, test in by_group(groups, data.objects, folds=folds, seed=settings.seed):
        learned, asked = data.select(train), data.select(test)
        forecaster = fit_forecaster(
            learned,
            guides=data.estimates.estimators,
            models=benchmark.models,
            forests=settings,
        )
        known = np.isin(asked.objects, forecaster.card.objects)
        asked = asked.select(known)
        best = best_fixed(learned)
        fixed = np.array([best[name] for name in asked.objects.tolist()], dtype=np.int64)
        scenes = groups[test][known]
        for k, name in enumerate(data.estimates.estimators):
            guided = forecaster.guided_by(name)
            ranked = guided.rank(asked.estimates, benchmark.models)
            plain = uncorrected(guided).probability(asked.estimates, benchmark.models)
            able = np.flatnonzero([bool(some) for some in ranked])
            places = {grasp: s for s, grasp in enumerate(data.grasps)}
            yield Held(
                scenes[able],
                asked.objects[able],
                asked.every_success[:, k, able],
                fixed[able],
                np.array([places[ranked[i][0].grasp] for i in able.tolist()]),
                np.array([ranked[i][0].probability for i in able.tolist()]),
                plain[able],
                np.array(
                    [
                        next(f.probability for f in ranked[i] if f.grasp == data.grasps[0])
                        for i in able.tolist()
                    ]
                ),
            )


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
    return replace(forecaster, predictor=replace(forecaster.predictor, choice=None))


def by_policy(held: list[Held]) -> dict[str, Float[ndarray, " n"]]:
    """Return the outcomes of always attempting by each policy."""
    each_of = [
        (each.success[0], each.outcome(each.fixed), each.outcome(each.chosen)) for each in held
    ]
    perfect = np.concatenate([np.nanmax(each.success, axis=0) for each in held])
    found = [*(np.concatenate(parts) for parts in zip(*each_of, strict=True)), perfect]
    return dict(zip(POLICIES, found, strict=True))


def summary(held: list[Held], seed: int) -> dict[str, object]:
    """Return success by policy, differences and calibration, with intervals."""
    scenes = np.concatenate([each.scenes for each in held])
    scene, number = np.unique(scenes, return_inverse=True)
    counts = original_and_draws(scene.tolist(), DRAWS, seed)

    def mean(values: ndarray, among: Bool[ndarray, " n"] | None = None) -> Float[ndarray, " d"]:
        weight = np.ones(len(values)) if among is None else among.astype(np.float64)
        sums = [
            np.bincount(number, weights=w, minlength=len(scene)) for w in (values * weight, weight)
        ]
        return np.asarray((counts @ sums[0]) / (counts @ sums[1]))

    def joined(of: str) -> ndarray:
        return np.concatenate([getattr(each, of) for each in held])

    outcomes = by_policy(held)
    out: dict[str, object] = {"n": len(scenes), "scenes": len(scene)}
    rates = {name: mean(values) for name, values in outcomes.items()}
    for name, draws in rates.items():
        out[f"success, {name}"] = interval(draws)
    out["chosen minus reference"] = interval(rates["chosen"] - rates["reference"])
    out["best fixed minus reference"] = interval(rates["best fixed"] - rates["reference"])
    out["chosen minus best fixed"] = interval(rates["chosen"] - rates["best fixed"])
    held_chosen = outcomes["chosen"]
    for name in ("probability", "uncorrected"):
        p = joined(name)
        label = "corrected" if name == "probability" else name
        out[f"{label}: mean forecast of the chosen"] = float(p.mean())
        out[f"{label}: forecast minus success"] = interval(mean(p - held_chosen))
        out[f"{label}: calibration error"] = calibration_error(p, held_chosen == 1)
        out[f"{label}: Brier score"] = float(np.mean((p - held_chosen) ** 2))
    for name, p, y in (
        ("reference", joined("reference"), outcomes["reference"]),
        ("chosen", joined("probability"), held_chosen),
    ):
        tried = p >= AT
        out[f"attempted from {AT}, {name}"] = interval(mean(tried.astype(float)))
        out[f"success of these, {name}"] = interval(mean(y, tried))
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
