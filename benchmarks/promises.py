"""How often promises are false: of the rate asked for, or else of the highest lower one.

    python benchmarks/promises.py --worlds 500
    python benchmarks/promises.py --worlds 500 --intervals

Calibrations of synthetic worlds (as in ``certificates.py``), many too small for the rate asked for,
0.9 at confidence 0.9. *Promised*: the rate asked for where it is certified, and else the lower rate
that is, as ``certify`` with ``accept_lower`` does. *False*: the true success rate at the threshold
is below the promised rate; 0.1 is allowed. *Searched*: what a user would get who, after seeing the
data, took the highest rate among the default and the learned sequence, rates weighted by attempts
and by scenes (each by its own true rate), and ``--seeds``; this is why these are no promises.
``--intervals``: instead, the share of the runs in which the 95 % interval of the success rate, as
in tables of thresholds, misses the true rate, at thresholds that attempt three quarters, half and a
quarter of the trials. Prints Markdown.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

from graspcast.evaluation.bootstrap import original_and_draws
from graspcast.evaluation.success_intervals import success_interval
from graspcast.guarantees.certificate import Guarantee
from graspcast.guarantees.certify import certify
from graspcast.guarantees.threshold_sequence import default_sequence, learn_sequence

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from worlds import Truth, World

RATE = CONFIDENCE = 0.9
WORLDS = {
    "10 scenes x 20 trials": World(10, 20),
    "10 x 20, over-dispersed": World(10, 20, scene=3.0),
    "10 x 20, repeats": World(10, 20, alike=1.0),
    "22 scenes x 10 trials": World(22, 10),
    "22 x 10, overconfident": World(22, 10, over=1.8),
    "50 scenes x 10 trials": World(50, 10),
    "50 x 10, repeats, over-dispersed": World(50, 10, scene=3.0, alike=1.0),
    "50 x 10, misleading scenes": World(50, 10, mislead=1.0),
    "200 scenes x 8 trials": World(200, 8),
    "10 x 20, forecasts nearly useless": World(10, 20, mislead=6.0),
    "60 x 1, forecasts nearly useless": World(60, 1, mislead=6.0),
    "200 x 1, forecasts nearly useless": World(200, 1, mislead=6.0),
}
SHARES = (0.75, 0.5, 0.25)


class SceneTruth:
    """The mean over scenes of the success rate of their attempts, by threshold."""

    def __init__(self, world: World):
        rng = np.random.default_rng(123_456)
        probability, success, _ = world.draw(rng, 20_000)
        self._p = probability.reshape(20_000, -1)
        self._s = success.reshape(20_000, -1)

    def rate(self, threshold: float) -> float:
        attempted = self._p >= threshold
        count = attempted.sum(axis=1)
        held = (attempted & self._s).sum(axis=1)
        return float((held[count > 0] / count[count > 0]).mean())


def is_false(guarantee: Guarantee, truth: Truth | SceneTruth) -> bool:
    threshold = guarantee.threshold
    return threshold is not None and truth.rate(threshold) < guarantee.rate


def drawn(world: World, number: int) -> tuple[Any, Any]:
    """Training and calibration data."""
    rng = np.random.default_rng([world.scenes, world.repeats, number])
    return world.draw(rng, world.scenes), world.draw(rng, world.scenes)


def promises(world: World, count: int, seeds: int) -> dict[str, str]:
    truths: dict[str, Any] = {"attempt": world.truth(), "unit": SceneTruth(world)}
    tally: dict[str, list[tuple[float, float, float]]] = {}
    for number in range(count):
        training, calibration = drawn(world, number)
        found: list[tuple[Guarantee, Any]] = []
        for weight in ("attempt", "unit"):
            for kind in ("default", "learned"):
                sequence = default_sequence(RATE)
                if kind == "learned":
                    sequence = learn_sequence(
                        *training,
                        rate=RATE,
                        confidence=CONFIDENCE,
                        calibration_units=world.scenes,
                        weight=weight,
                    )
                for seed in range(seeds):
                    mine = certify(
                        *calibration,
                        rate=RATE,
                        confidence=CONFIDENCE,
                        sequence=sequence,
                        weight=weight,
                        accept_lower=True,
                        seed=seed,
                    ).overall
                    found.append((mine, truths[weight]))
                    if seed == 0:
                        add(tally, f"{weight}s, {kind}", mine, truths[weight])
        some = [f for f in found if f[0].best is not None]
        if some:
            best, truth = max(some, key=lambda f: f[0].best.rate)
            told = best.best
            add_one(tally, "searched", truth.rate(told.threshold) < told.rate, told.rate)
        else:
            add_one(tally, "searched", False, 0.0)
    means = {name: np.mean(rows, axis=0).tolist() for name, rows in tally.items()}
    return {name: f"{f:.3f} / {n:.3f} / {r:.2f}" for name, (f, n, r) in means.items()}


def intervals(world: World, count: int) -> dict[str, str]:
    truth = world.truth()
    thresholds = [float(np.quantile(truth.descending, 1 - s)) for s in SHARES]
    counts = original_and_draws([f"{i:04d}" for i in range(world.scenes)], 500, 0)
    outside = np.zeros(len(SHARES))
    for number in range(count):
        probability, success, units = drawn(world, number)[1]
        for i, threshold in enumerate(thresholds):
            found = success_interval(probability >= threshold, success, units, counts)
            true = truth.rate(threshold)
            outside[i] += found is not None and not found.low <= true <= found.high
    return {f"{s:.0%} attempted": f"{x / count:.3f}" for s, x in zip(SHARES, outside, strict=True)}


def add(tally: dict[str, list], name: str, guarantee: Guarantee, truth: Any) -> None:
    none = guarantee.threshold is None
    row = (is_false(guarantee, truth), none, 0.0 if none else guarantee.rate)
    tally.setdefault(name, []).append(row)


def add_one(tally: dict[str, list], name: str, false: bool, rate: float) -> None:
    tally.setdefault(name, []).append((false, rate == 0.0, rate))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=500, help="of each kind (default: 500)")
    parser.add_argument("--only", metavar="TEXT", default="", help="worlds with this in the name")
    parser.add_argument("--seeds", type=int, default=2, help="that are searched (default: 2)")
    parser.add_argument("--intervals", action="store_true", help="how often intervals miss")
    options = parser.parse_args()
    print(f"Rate {RATE}, confidence {CONFIDENCE}, {options.worlds} worlds of each kind.")
    print(f"Cells: {'missed' if options.intervals else 'false / none / mean promised rate'}.\n")
    header = False
    for title, world in WORLDS.items():
        if options.only not in title:
            continue
        if options.intervals:
            cells = intervals(world, options.worlds)
        else:
            cells = promises(world, options.worlds, options.seeds)
        if not header:
            print(f"| simulation | {' | '.join(cells)} |\n|---|{'---|' * len(cells)}")
            header = True
        print(f"| {title} | {' | '.join(cells.values())} |", flush=True)


if __name__ == "__main__":
    main()
