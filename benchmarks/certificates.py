"""How often certificates are false, and how many attempts they allow, in synthetic worlds.

    pip install 'mapie>=1.6'        # only for the comparison with it; --without-mapie leaves it out
    python benchmarks/certificates.py --worlds 1000 --json certificates.json

Every run draws new calibration data (and, where a method learns its sequence, training data of the
same size); the true rates are those of a million further trials. *False*: a threshold was
certified, and the true P(success | attempted) is below the rate. *None*: no threshold was
certified. *Attempts*: the true share of attempts at the certified threshold (0 if none), relative
to the largest share that reaches the rate. Prints Markdown.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy import ndarray

from graspcast.guarantees.binomial import p_value
from graspcast.guarantees.certify import certify
from graspcast.guarantees.drift_monitor import DriftMonitor
from graspcast.guarantees.threshold_sequence import default_sequence, learn_sequence
from graspcast.guarantees.unit_draws import Weight

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from worlds import World

RATE = CONFIDENCE = 0.9
WORLDS = {
    "500 scenes x 1 trial": World(500, 1),
    "50 scenes x 10 trials": World(50, 10),
    "50 x 10, over-dispersed": World(50, 10, scene=3.0),
    "50 x 10, repeats": World(50, 10, alike=1.0),
    "50 x 10, repeats, over-dispersed": World(50, 10, scene=3.0, alike=1.0),
    "200 x 8, repeats": World(200, 8, alike=1.0),
    "200 scenes x 8 trials": World(200, 8),
    "200 x 8, overconfident": World(200, 8, over=1.8),
    "200 x 8, underconfident": World(200, 8, over=0.6),
    "200 x 8, misleading scenes": World(200, 8, mislead=1.0),
    "1,000 scenes x 5 trials": World(1000, 5),
}
Data = tuple[ndarray, ndarray, ndarray]
Method = Callable[[Data, Data], float | None]


def ours(weight: Weight, *, learn: bool, naive: bool = False) -> Method:
    def method(training: Data, calibration: Data) -> float | None:
        probability, success, units = calibration
        if naive:
            training = (*training[:2], np.arange(len(training[0])))
            units = np.arange(len(units))
        sequence = default_sequence(RATE)
        if learn:
            sequence = learn_sequence(
                *training,
                rate=RATE,
                confidence=CONFIDENCE,
                calibration_units=len(np.unique(units)),
                weight=weight,
            )
        certificate = certify(
            probability,
            success,
            units,
            rate=RATE,
            confidence=CONFIDENCE,
            sequence=sequence,
            weight=weight,
        )
        return certificate.overall.threshold

    return method


def another(test: Callable[[ndarray, ndarray], float]) -> Method:
    """The learned sequence with another p-value, for comparison with one draw of each unit."""

    def method(training: Data, calibration: Data) -> float | None:
        probability, success, units = calibration
        scenes = int(units[-1]) + 1
        sequence = learn_sequence(
            *training, rate=RATE, confidence=CONFIDENCE, calibration_units=scenes
        )
        best = None
        for threshold in sequence.thresholds[sequence.weights.index(1.0) :]:
            attempt = (probability >= threshold).reshape(scenes, -1)
            if test(attempt, success.reshape(scenes, -1)) > 1.0 - CONFIDENCE:
                break
            best = threshold
        return best

    return method


def median_of_draws(attempt: ndarray, success: ndarray) -> float:
    """Twice the median of the exact p-values of 101 draws is a p-value."""
    scenes, repeats = attempt.shape
    rng = np.random.default_rng(0)
    drawn = np.arange(scenes), rng.integers(repeats, size=(101, scenes))
    count, held = attempt[drawn].sum(axis=1), (attempt & success)[drawn].sum(axis=1)
    values = [p_value(int(h), int(c), RATE) for h, c in zip(held, count, strict=True)]
    return 2.0 * float(np.median(values))


def bets(attempt: ndarray, success: ndarray) -> float:
    """A mixture of bets that each scene's failures are fewer than its attempts allow.

    The loss (failures - (1 - rate) attempts) / trials is at most the rate, and at least 0 on
    average where the rate is not reached, so that every product has a mean of at most 1.
    """
    loss = ((attempt & ~success).sum(axis=1) - (1 - RATE) * attempt.sum(axis=1)) / attempt.shape[1]
    stakes = np.linspace(0.02, 0.999, 40) / RATE
    return float(1.0 / np.exp(np.log1p(-np.outer(stakes, loss)).sum(axis=1)).mean())


def mapie(fwer: str) -> Method:
    try:
        from mapie.risk_control import BinaryClassificationController
    except ImportError:
        sys.exit("this compares with MAPIE: pip install 'mapie>=1.6', or give --without-mapie")

    def method(_: Data, calibration: Data) -> float | None:
        probability, success, _ = calibration
        controller = BinaryClassificationController(
            lambda x: np.column_stack([1 - x[:, 0], x[:, 0]]),
            risk="precision",
            target_level=RATE,
            confidence_level=CONFIDENCE,
            fwer_method=fwer,
        )
        controller.calibrate(probability[:, None], success.astype(int))
        best = controller.best_predict_param
        return None if best is None else float(best)

    return method


def methods(with_mapie: bool, alternatives: bool) -> dict[str, Method]:
    if alternatives:
        return {
            "one draw (default), learned sequence": ours("attempt", learn=True),
            "twice the median of draws, learned sequence": another(median_of_draws),
            "bets, learned sequence": another(bets),
        }
    out = {
        "trials as units, default sequence": ours("attempt", learn=False, naive=True),
        "trials as units, learned sequence": ours("attempt", learn=True, naive=True),
        "attempts weighted equally, default sequence": ours("attempt", learn=False),
        "attempts weighted equally, learned sequence": ours("attempt", learn=True),
        "scenes weighted equally, default sequence": ours("unit", learn=False),
        "scenes weighted equally, learned sequence": ours("unit", learn=True),
    }
    if with_mapie:
        out["MAPIE, its default"] = mapie("bonferroni_holm")
    return out


def run(world: World, chosen: dict[str, Method], count: int) -> tuple[float, dict[str, dict]]:
    truth = world.truth()
    best = truth.best_attempts(RATE)
    tally: dict[str, list[tuple[bool, bool, float]]] = {name: [] for name in chosen}
    for number in range(count):
        rng = np.random.default_rng([world.scenes, world.repeats, number])
        training, calibration = world.draw(rng, world.scenes), world.draw(rng, world.scenes)
        for name, method in chosen.items():
            threshold = method(training, calibration)
            if threshold is None:
                tally[name].append((False, True, 0.0))
            else:
                false = truth.rate(threshold) < RATE
                tally[name].append((false, False, truth.attempts(threshold) / best))
    keys = ("false", "none", "attempts")
    return best, {
        name: dict(zip(keys, np.mean(rows, axis=0).round(4).tolist(), strict=True))
        for name, rows in tally.items()
    }


def monitor(runs: int, length: int) -> dict[str, dict[str, float]]:
    """False alarms and delays of the drift monitor at alpha 0.05, guaranteed rate 0.9."""
    rng = np.random.default_rng(0)
    out: dict[str, dict[str, float]] = {}

    def alarm(rates: ndarray) -> int | None:
        watch = DriftMonitor(rate=RATE, alpha=0.05)
        for success in rng.random(len(rates)) < rates:
            if watch.observe(bool(success)):
                return watch.alarm_at
        return None

    false = [alarm(np.full(length, RATE)) is not None for _ in range(runs)]
    out[f"exactly 0.9, {length} attempts"] = {"alarmed": float(np.mean(false))}
    for before in (0, 500):
        for after in (0.8, 0.7, 0.5):
            rates = np.r_[np.full(before, 0.95), np.full(2000, after)]
            found = [alarm(rates) for _ in range(max(runs // 5, 20))]
            delays = [np.inf if a is None else a - before for a in found if a is None or a > before]
            out[f"{before} attempts at 0.95, then {after}"] = {
                "alarmed": float(np.isfinite(delays).mean()),
                "median": float(np.median(delays)),
                "nine of ten": float(np.quantile(delays, 0.9, method="higher")),
            }
    return out


def print_monitor(monitored: dict[str, dict[str, float]]) -> None:
    print("\n| attempts | alarmed | median attempts to the alarm | nine of ten within |")
    print("|---|---:|---:|---:|")
    for name, row in monitored.items():
        delays = (f"{row[k]:.0f}" if k in row else "-" for k in ("median", "nine of ten"))
        print(f"| {name} | {row['alarmed']:.3f} | {' | '.join(delays)} |")


def main() -> None:
    # MAPIE warns when it finds no threshold.
    warnings.filterwarnings("ignore", message="No predict parameters were found")
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=1000, help="of each kind (default: 1000)")
    parser.add_argument("--without-mapie", action="store_true")
    parser.add_argument("--only", metavar="TEXT", default="", help="worlds with this in the name")
    parser.add_argument(
        "--alternatives", action="store_true", help="other exact tests with one unit a scene"
    )
    parser.add_argument("--json", metavar="FILE", type=Path)
    options = parser.parse_args()
    chosen = methods(not options.without_mapie, options.alternatives)
    found = {}
    print(f"Rate {RATE}, confidence {CONFIDENCE}, {options.worlds} worlds of each kind.\n")
    print("Cells: false / none / attempts.\n")
    print(f"| world | {' | '.join(chosen)} |\n|---|{'---|' * len(chosen)}")
    for title, world in WORLDS.items():
        if options.only not in title:
            continue
        start = time.perf_counter()
        best, rows = run(world, chosen, options.worlds)
        found[title] = {"best_attempts": best, "methods": rows}
        cells = (" / ".join(f"{value:.3f}" for value in row.values()) for row in rows.values())
        print(f"| {title} (at best {best:.0%}) | {' | '.join(cells)} |", flush=True)
        print(f"{title}: {time.perf_counter() - start:.0f} s", file=sys.stderr)
    monitored = {}
    if not (options.only or options.alternatives):
        monitored = monitor(max(options.worlds // 2, 20), 2000)
        print_monitor(monitored)
    if options.json:
        content = {"worlds": options.worlds, "certificates": found, "monitor": monitored}
        options.json.write_text(json.dumps(content, indent=2) + "\n")


if __name__ == "__main__":
    main()
