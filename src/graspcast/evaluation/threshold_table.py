"""What each threshold is worth: attempts, successes, looks and net benefit, and the best threshold.

The best threshold of some data looks better on these data than it will be. So there is a figure
beside it that does not: for each fold of scenes the best threshold of the other scenes is used
(:mod:`graspcast.evaluation.best_threshold`). Without outcomes the forecast stands for the outcome,
so figures are what the forecasts expect.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.evaluation.best_threshold import Trials, best_threshold, on_other_scenes
from graspcast.evaluation.bootstrap import Interval, original_and_draws
from graspcast.evaluation.net_benefit import Costs
from graspcast.evaluation.success_intervals import success_interval
from graspcast.guarantees.attempts import first_to_reach

__all__ = ["BestThreshold", "ThresholdRow", "ThresholdTable", "advice", "threshold_table"]

_SHARES = (0.15, 0.3, 0.45, 0.6, 0.75, 0.9)
"""Which shares of the forecasts are above the thresholds of a table, beside 1 (threshold 0)."""


@dataclass(frozen=True)
class ThresholdRow:
    """What one threshold is worth.

    Attributes
    ----------
    threshold
        Attempt at this probability or above it.
    attempts, attempted
        How many instances are attempted, and which share.
    success
        Success rate of these with its interval over scenes; without outcomes what the forecasts
        expect, without an interval; None without attempts.
    looks
        Mean number of looks at an instance.
    net_benefit
        Mean of an instance.
    asked, break_even, best
        Whether it is the threshold in use, the break-even probability of the costs, and the one
        with the highest net benefit on these data.
    """

    threshold: float
    attempts: int
    attempted: float
    success: Interval | None
    looks: float
    net_benefit: float
    asked: bool
    break_even: bool
    best: bool


@dataclass(frozen=True)
class BestThreshold:
    """The threshold with the highest net benefit on some data, and what that is worth.

    Attributes
    ----------
    threshold
        None: attempting nothing is best.
    net_benefit
        On the data on which it was chosen, so more than may be expected.
    elsewhere
        Net benefit of thresholds chosen so, on scenes on which they were not chosen; None with one
        scene, or without outcomes.
    at_break_even
        Net benefit at the break-even probability, which no data chose; None without outcomes.
    """

    threshold: float | None
    net_benefit: float
    elsewhere: Interval | None
    at_break_even: Interval | None


@dataclass(frozen=True)
class ThresholdTable:
    """What thresholds are worth on some instances.

    Attributes
    ----------
    rows
        By falling threshold.
    n, scenes
        Instances, and their scenes.
    costs
        In units of the gain of a success.
    measured
        Whether there are outcomes; otherwise figures are what the forecasts expect.
    best
        Of all thresholds, not only those in the table.
    most
        No threshold above this could be judged; None if any could.
    """

    rows: tuple[ThresholdRow, ...]
    n: int
    scenes: int
    costs: Costs
    measured: bool
    best: BestThreshold
    most: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return plain numbers, for JSON; NaN becomes None."""
        out: dict[str, Any] = _plain(asdict(self))
        return out


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def threshold_table(
    trials: Trials,
    costs: Costs,
    *,
    asked: float | None = None,
    most: float | None = None,
    at: Sequence[float] | None = None,
    draws: int = 2000,
    seed: int = 0,
) -> ThresholdTable:
    """Return what thresholds are worth: at most ten, and the best of all.

    Parameters
    ----------
    trials
        Forecasts, with outcomes or without.
    costs
        In units of the gain of a success.
    asked
        The threshold in use, which is in the table.
    most
        Leave out thresholds above this: what the policy would do there was not recorded.
    at
        The thresholds of the table; if None, those in use, at the break-even probability, the best
        one, 0, and some that attempt certain shares of the instances.
    draws, seed
        Of the bootstrap, and of the folds of scenes.

    Raises
    ------
    InputError
        If there are no instances.
    """
    if not len(trials.probability):
        raise InputError("there is nothing to choose a threshold on")
    scenes, numbers = np.unique(trials.scenes, return_inverse=True)
    counts = original_and_draws(scenes.tolist(), draws, seed)
    best, value = best_threshold(trials, costs, most=most)
    break_even = round(costs.break_even, 9)
    fixed = {break_even} | ({asked} if asked is not None else set())
    fixed |= {best} if best is not None else set()
    allowed = np.inf if most is None else most
    wanted = fixed | _quantiles(trials, allowed) if at is None else set(at)
    thresholds = sorted({t for t in wanted if t <= allowed}, reverse=True)
    rows = []
    for threshold in thresholds:
        attempted, success, looks = trials.at(threshold)
        rate: Interval | None
        if trials.success is not None:
            rate = success_interval(attempted, success, numbers, counts)
        else:
            expected = float(success[attempted].mean()) if attempted.any() else None
            rate = None if expected is None else Interval(expected, math.nan, math.nan)
        rows.append(
            ThresholdRow(
                threshold=threshold,
                attempts=int(attempted.sum()),
                attempted=float(attempted.mean()),
                success=rate,
                looks=float(looks.mean()),
                net_benefit=float(trials.net_benefit(threshold, costs).mean()),
                asked=threshold == asked,
                break_even=threshold == break_even,
                best=threshold == best,
            )
        )
    elsewhere = at_break_even = None
    if trials.success is not None:
        if break_even <= allowed:
            at_break_even = _mean(trials.net_benefit(break_even, costs), numbers, counts)
        if len(scenes) > 1:
            held_out = on_other_scenes(trials, costs, most, seed)
            elsewhere = _mean(held_out, numbers, counts)
    found = BestThreshold(best, value, elsewhere, at_break_even)
    measured = trials.success is not None
    return ThresholdTable(tuple(rows), len(numbers), len(scenes), costs, measured, found, most)


def advice(table: ThresholdTable) -> str:
    """Say which threshold is best, and what that is worth where it was not chosen."""
    best = table.best
    at = "attempting nothing" if best.threshold is None else f"threshold {best.threshold:g}"
    if not table.measured:
        return (
            f"Best by the forecasts: {at}, net benefit {best.net_benefit:+.3f} expected. Without "
            "outcomes that is what the forecasts say of themselves."
        )
    text = f"Best on these grasps: {at}, net benefit {best.net_benefit:+.3f}"
    if best.elsewhere is not None:
        text += (
            f"; chosen so on some scenes and tried on the others, {best.elsewhere:+}. The latter "
            "is what to expect"
        )
    if best.at_break_even is not None:
        text += (
            f". At the break-even probability {table.costs.break_even:.3g}, which no data chose: "
            f"{best.at_break_even:+}"
        )
    return f"{text}."


def _quantiles(trials: Trials, most: float) -> set[float]:
    """Return thresholds, to two digits, that divide the forecasts up to ``most`` evenly; and 0.

    What is attempted at no threshold counts as not attempted.
    """
    if trials.probability.shape[1] == 1:
        found = np.where(np.isnan(trials.probability), 0.0, trials.probability)
    else:
        found = trials.probability[first_to_reach(trials.probability)]
    found = found[found <= most]
    if not found.size:
        return {0.0}
    ends = np.quantile(found, [1.0 - share for share in _SHARES], method="lower")
    return {0.0, *(math.floor(t * 100) / 100 for t in ends.tolist())}


def _mean(
    values: Float[ndarray, " n"], numbers: Int[ndarray, " n"], counts: Int[ndarray, "draws1 scenes"]
) -> Interval:
    """Return the mean over instances, with its interval by drawing scenes."""
    width = counts.shape[1]
    total = counts @ np.bincount(numbers, weights=values, minlength=width)
    found = total / (counts @ np.bincount(numbers, minlength=width))
    return Interval.of(found[0], found[1:])
