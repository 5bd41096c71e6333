"""How often promises are false: of the rate asked for, or else of the highest lower one.

    python benchmarks/promises.py --worlds 500

Calibrations of synthetic worlds (as in ``certificates.py``), many too small for the rate asked for,
0.9 at confidence 0.9. *Promised*: the rate asked for where it is certified, and else the lower rate
that is, as ``certify`` with ``accept_lower`` does. *False*: the true success rate at the threshold
is below the promised rate; 0.1 is allowed. *Searched*: what a user would get who, after seeing the
data, took the highest rate among the default and the learned sequence, rates weighted by attempts
and by scenes (each by its own true rate), and two seeds; this is why these are no promises.
*Wide*: the share of true rates outside the 95 % interval of success rates in tables of thresholds,
at thresholds that attempt three quarters, half and a quarter. Prints Markdown.
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


def run(world: World, count: int) -> tuple[dict[str, dict[str, float]], list[float]]:
    truths: dict[str, Any] = {"attempt": world.truth(), "unit": SceneTruth(world)}
    tally: dict[str, list[tuple[float, float, float]]] = {}
    thresholds = [float(np.quantile(truths["attempt"].descending, 1 - s)) for s in SHARES]
    names = [f"{i:04d}" for i in range(world.scenes)]
    counts = original_and_draws(names, 500, 0)
    outside = np.zeros(len(SHARES))
    for number in range(count):
        rng = np.random.default_rng([world.scenes, world.repeats, number])
        training, calibration = world.draw(rng, world.scenes), world.draw(rng, world.scenes)
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
                for seed in range(2):
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
        probability, success, units = calibration
        for i, threshold in enumerate(thresholds):
            interval = success_interval(
                probability >= threshold, success.astype(float), units, counts
            )
            true = truths["attempt"].rate(threshold)
            outside[i] += interval is not None and not interval.low <= true <= interval.high
    means = {
        name: dict(zip(("false", "none", "rate"), np.mean(rows, axis=0).tolist(), strict=True))
        for name, rows in tally.items()
    }
    return means, (outside / count).tolist()


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
    options = parser.parse_args()
    print(f"Rate {RATE}, confidence {CONFIDENCE}, {options.worlds} worlds of each kind.")
    print("Cells: false / none / mean promised rate.\n")
    header = False
    for title, world in WORLDS.items():
        if options.only not in title:
            continue
        rows, outside = run(world, options.worlds)
        if not header:
            print(f"| simulation | {' | '.join(rows)} | outside the interval |")
            print(f"|---|{'---|' * (len(rows) + 1)}")
            header = True
        cells = [f"{r['false']:.3f} / {r['none']:.3f} / {r['rate']:.2f}" for r in rows.values()]
        shown = ", ".join(f"{x:.3f}" for x in outside)
        print(f"| {title} | {' | '.join(cells)} | {shown} |", flush=True)


if __name__ == "__main__":
    main()
