"""The threshold with the highest net benefit, of forecasts after one look or several.

A trial has one forecast, or several in order, after one look, two, and so on; at a threshold the
first that reaches it is attempted (:mod:`graspcast.guarantees.attempts`). The net benefit of an
instance is 1 for a success, ``-failure`` for an attempt that fails and ``-abstention`` for none, in
each case less ``look`` for every look after the first (:mod:`graspcast.evaluation.net_benefit`).
As a function of the threshold its mean is constant between forecasts, so that the best threshold is
found exactly, by one pass over the sorted forecasts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.evaluation.net_benefit import Costs
from graspcast.forecasting.splits import fold_numbers
from graspcast.guarantees.attempts import first_to_reach

__all__ = ["Trials", "best_threshold", "on_other_scenes"]

_FOLDS = 5


@dataclass(frozen=True, eq=False)
class Trials:
    """Forecasts of n instances after each of s looks, and what came of the grasps.

    Attributes
    ----------
    probability
        NaN where nothing is attempted at any threshold, (n, s).
    success
        Whether the grasp succeeds that would be tried there, 1 or 0; None without outcomes, (n, s).
    looks
        Looks taken until each of these forecasts, (n, s).
    ended
        Looks taken where none of them reaches the threshold, (n,).
    scenes
        The scene of each, (n,).
    """

    probability: Float[ndarray, "n s"]
    success: Float[ndarray, "n s"] | None
    looks: Int[ndarray, "n s"]
    ended: Int[ndarray, " n"]
    scenes: ndarray

    @classmethod
    def of_one_look(
        cls,
        probability: Float[ndarray, " n"],
        success: Float[ndarray, " n"] | Bool[ndarray, " n"] | None,
        scenes: ndarray,
        looks: Int[ndarray, " n"] | None = None,
    ) -> Trials:
        """Return trials with one forecast each; by default of one look."""
        taken = np.ones(len(probability), dtype=np.int64) if looks is None else looks
        held = None if success is None else np.asarray(success, dtype=np.float64)[:, None]
        return cls(probability[:, None], held, taken[:, None], taken, scenes)

    @property
    def outcome(self) -> Float[ndarray, "n s"]:
        """The outcomes, or the forecasts that stand for them; 0 where nothing is attempted."""
        found = self.probability if self.success is None else self.success
        return np.where(np.isnan(self.probability), 0.0, found)

    def at(
        self, threshold: float
    ) -> tuple[Bool[ndarray, " n"], Float[ndarray, " n"], Int[ndarray, " n"]]:
        """Return which are attempted at a threshold, with what success, after how many looks."""
        reached: ndarray = self.probability >= threshold  # False where it is NaN
        attempted = np.asarray(reached.any(axis=1))
        first = reached.argmax(axis=1)
        every = np.arange(len(first))
        looks = np.where(attempted, self.looks[every, first], self.ended)
        return attempted, np.where(attempted, self.outcome[every, first], 0.0), looks

    def net_benefit(self, threshold: float, costs: Costs) -> Float[ndarray, " n"]:
        """Return the net benefit of each instance at a threshold."""
        attempted, success, looks = self.at(threshold)
        gained = success - (1.0 - success) * costs.failure
        return np.where(attempted, gained, -costs.abstention) - costs.look * (looks - 1)

    def select(self, rows: ndarray) -> Trials:
        """Return some instances, by a mask or numbers."""
        success = None if self.success is None else self.success[rows]
        return Trials(
            self.probability[rows], success, self.looks[rows], self.ended[rows], self.scenes[rows]
        )


def best_threshold(
    trials: Trials, costs: Costs, *, most: float | None = None
) -> tuple[float | None, float]:
    """Return the threshold with the highest mean net benefit, and that; the strictest of equal.

    Parameters
    ----------
    trials, costs, most
        As for :func:`graspcast.evaluation.threshold_table.threshold_table`.

    Returns
    -------
        The threshold, rounded down as far as that makes no difference, or None where attempting
        nothing is best; and the mean net benefit there.
    """
    steps = np.where(first_to_reach(trials.probability), trials.probability, np.nan)
    success = trials.outcome
    gained = success - (1.0 - success) * costs.failure - costs.look * (trials.looks - 1)
    later = -costs.abstention - costs.look * (trials.ended - 1.0)
    value = float(later.mean())
    change = np.zeros_like(gained)
    for k in reversed(range(gained.shape[1])):
        step = ~np.isnan(steps[:, k])
        change[step, k] = (gained[:, k] - later)[step]
        later = np.where(step, gained[:, k], later)
    kept = ~np.isnan(steps)
    order = np.argsort(-steps[kept], kind="stable")
    at, sums = steps[kept][order], value + np.cumsum(change[kept][order]) / len(gained)
    last = np.append(at[1:] != at[:-1], True)[: len(at)]
    at, sums = at[last], sums[last]
    if most is not None:
        # Thresholds above were not judged; among them is that of attempting nothing.
        low = int(np.searchsorted(-at, -most, side="right"))
        start = most, float(trials.net_benefit(most, costs).mean())
        at, sums = np.append(start[0], at[low:]), np.append(start[1], sums[low:])
        value = -np.inf
    if not len(at) or sums.max() <= value + 1e-12:
        return None, value
    i = int(np.argmax(sums >= sums.max() - 1e-12))
    return _rounded(float(at[i]), float(at[i + 1]) if i + 1 < len(at) else -1.0), float(sums[i])


def _rounded(value: float, below: float) -> float:
    """Return the shortest decimal that is not above a value, and above the next forecast below."""
    for digits in range(2, 16):
        short = math.floor(value * 10**digits) / 10**digits
        if below < short <= value:
            return short
    return value


def on_other_scenes(
    trials: Trials, costs: Costs, most: float | None, seed: int
) -> Float[ndarray, " n"]:
    """Return the net benefit of each instance at the best threshold of other scenes.

    Parameters
    ----------
    trials, costs, most
        As for :func:`best_threshold`; of two scenes or more.
    seed
        Of the folds of scenes.
    """
    fold = fold_numbers(trials.scenes, _FOLDS, seed=seed)
    out = np.empty(len(fold))
    for number in range(int(fold.max()) + 1):
        mine = fold == number
        threshold, _ = best_threshold(trials.select(~mine), costs, most=most)
        at = np.inf if threshold is None else threshold
        out[mine] = trials.select(mine).net_benefit(at, costs)
    return out
