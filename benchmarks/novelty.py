"""How often displaced supporters are noticed, and unchanged instances wrongly flagged.

    python benchmarks/novelty.py --data DIR --json novelty.json

For each principal of the published data, forecasters are trained on n instances drawn from four
fifths of the scenes, and asked about the instances of the others: unchanged, and with supporters
displaced or turned in random directions (one of them; each in its own direction; all alike; all
alike with the principal, so that nothing disagrees).

An unchanged instance is gross where a supporter lies 300 mm or more from the principal: such real
failures cannot be told from displaced ones. A false alarm is a flag on an instance that is not.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.instances import scene_groups
from graspcast.evaluation.benchmark import Benchmark
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.splits import by_group
from graspcast.forecasting.train import fit_forecaster
from graspcast.forecasting.training_data import TrainingData
from graspcast.io.markdown import table
from graspcast.paper.dataset import Published
from graspcast.pose.transforms import rotation_from_vector

SIZES = (20, 50, 100, 1000)
SHIFTS_MM, TURNS_DEG = (30, 100, 300, 1000), (30, 90, 180)
GROSS_M = 0.3
GRIPPER = "parallel"


def directions(rng: np.random.Generator, n: int) -> ndarray:
    out = rng.normal(size=(n, 3))
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))


def changed(
    given: Estimates, principal: str, rng: np.random.Generator
) -> Iterator[tuple[str, Estimates]]:
    """Yield every kind of change by name, with the changed estimates."""
    n = len(given)
    supporters = [given.index(name) for name in given.supporters(principal)]
    one = supporters[int(rng.integers(len(supporters)))]
    for mm in SHIFTS_MM:
        for who, rows in (("one", [one]), ("each", supporters), ("all alike", supporters)):
            poses, shared = given.cam_T_obj.copy(), directions(rng, n)
            for k in rows:
                by = shared if who == "all alike" else directions(rng, n)
                poses[k, :, :3, 3] += by * mm / 1000
            yield f"{mm} mm, {who}", replace(given, cam_T_obj=poses)
    for mm in (300, 1000, 2000):
        poses = given.cam_T_obj.copy()
        poses[:, :, :3, 3] += directions(rng, n) * mm / 1000
        yield f"{mm} mm, the principal too", replace(given, cam_T_obj=poses)
    for degrees in TURNS_DEG:
        for who, rows in (("one", [one]), ("each", supporters)):
            poses = given.cam_T_obj.copy()
            for k in rows:
                turn = rotation_from_vector(directions(rng, n) * np.radians(degrees))
                poses[k, :, :3, :3] = poses[k, :, :3, :3] @ turn
            yield f"{degrees} degrees, {who}", replace(given, cam_T_obj=poses)


def flags(forecaster: Forecaster, given: Estimates, data: Benchmark) -> tuple[ndarray, ndarray]:
    """Return which instances are flagged, and which would be attempted if none were."""
    attempted = forecaster.probability(given, data.models) >= 0.5
    novel = [each.is_novel(0.01) is True for each in forecaster.disagreements(given)]
    return np.array(novel, dtype=bool), attempted


def farthest_m(given: Estimates, principal: str) -> ndarray:
    """Return the distance of the farthest supporter from the principal, metres."""
    at = given.of(principal)[:, :3, 3]
    each = [given.of(name)[:, :3, 3] - at for name in given.supporters(principal)]
    return np.asarray(np.linalg.norm(each, axis=2).max(axis=0))


def measure(data: Benchmark, seeds: int, trees: int) -> dict[int, dict[str, float]]:
    """Return for each number of training instances the share of each outcome."""
    counts: dict[int, dict[str, list[float]]] = {n: defaultdict(list) for n in SIZES}
    for seed in range(seeds):
        for principal in data.estimates.estimators:
            tried = TrainingData.join(
                data.estimates, data.outcomes, principal, GRIPPER, truth=data.truth
            ).tried()
            groups, success = scene_groups(tried.estimates.instances), tried.own_success == 1
            for fold, (train, test) in enumerate(
                by_group(groups, tried.objects, success, seed=seed)
            ):
                for n in SIZES:
                    rng = np.random.default_rng([seed, fold, n])
                    rows = np.sort(rng.choice(train, min(n, len(train)), replace=False))
                    try:
                        forecaster = fit_forecaster(
                            tried.select(rows),
                            forests=ForestSettings(trees=trees),
                            models=data.models,
                        )
                    except InputError as error:  # all of few outcomes may be equal
                        print(f"skipped: {error}")
                        continue
                    known = test[np.isin(tried.objects[test], forecaster.card.objects)]
                    given, held = tried.estimates.select(known), success[known]
                    mine = counts[n]
                    flagged, attempted = flags(forecaster, given, data)
                    gross = farthest_m(given, principal) >= GROSS_M
                    mine["flagged, all"].append(flagged.mean())
                    mine["flagged, not gross (false alarms)"].append(flagged[~gross].mean())
                    mine["flagged, of grasps that succeed"].append(flagged[held].mean())
                    mine["attempts lost"].append((flagged & attempted).mean())
                    mine["successful attempts lost"].append((flagged & attempted & held).mean())
                    mine["gross"].append(gross.mean())
                    for name, other in changed(given, principal, rng):
                        flagged, attempted = flags(forecaster, other, data)
                        mine[f"{name}: flagged"].append(flagged.mean())
                        mine[f"{name}: flagged or not attempted"].append(
                            (flagged | ~attempted).mean()
                        )
            print(f"seed {seed}, {principal}", flush=True)
    return {n: {k: float(np.mean(v)) for k, v in each.items()} for n, each in counts.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="holds published/, raw/ and bop/")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--trees", type=int, default=32)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    data = Benchmark.of(Published(options.data))
    found = measure(data, options.seeds, options.trees)
    names = list(found[SIZES[0]])
    rows = [[name, *(f"{found[n][name]:.3f}" for n in SIZES)] for name in names]
    print(table(["share of instances", *(f"n = {n}" for n in SIZES)], rows))
    if options.json:
        options.json.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
