"""One independent trial from each scene or image, and what each of them holds at a threshold.

Trials in one scene are not independent: they share light, clutter and camera. *Units* (scenes, or
images) are assumed to be independent, so each unit contributes one trial to the test, drawn by a
seeded generator that does not depend on outcomes. The drawn trials are independent Bernoulli
trials, whatever the dependence within a unit, so a binomial test on them is exact. The other trials
of a unit serve to estimate the attempt rate.

There are two weightings:

``attempt``
    One of *all* trials of a unit is drawn, and counts if it is attempted. A unit that is smaller
    than the largest is skipped with probability 1 - size / largest size, since its instances are
    rarer. The drawn attempts succeed with probability P(success | attempted), all attempts being
    weighted equally. m units of which a share q of the trials is attempted yield about m q trials.
``unit``
    One of the *attempted* trials of a unit is drawn, if it has any. These succeed with the mean
    over units of the unit's success rate, all units being weighted equally. This needs fewer units,
    but guarantees less: a forecaster that attempts most in the scenes where it is most mistaken can
    satisfy it and still fall short of the rate over all attempts.

The two coincide where the share of attempts is the same in all units, or units hold one trial each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.guarantees.attempts import Forecasts, Outcomes, attempts_at, of_looks
from graspcast.io.hashing import sha256

__all__ = ["UnitDraws", "UnitShares", "Weight"]

Weight = Literal["attempt", "unit"]


class UnitDraws:
    """One trial of each unit, drawn independently of outcomes and of the order of the trials.

    Parameters
    ----------
    probability, success
        Forecasts and outcomes (:mod:`graspcast.guarantees.attempts`).
    number
        The number of each trial's unit, from 0, (n,).
    weight
        Of which trials one is drawn; see this module's description.
    seed
        Of the draws.
    """

    def __init__(
        self,
        probability: Forecasts,
        success: Outcomes,
        number: Int[ndarray, " n"],
        weight: Weight,
        seed: int,
    ):
        # The generator is seeded with the data too: if it were the same for all data, a seed that
        # happens to favour the most probable trials of the units would do so in every calibration.
        absent = np.isnan(probability)
        filled = np.where(absent, 0.0, probability).astype(np.float64)
        keys = (*of_looks(absent).T, *of_looks(success).T, *of_looks(filled).T)
        order = np.lexsort((*keys, number))
        digest = sha256(number[order].astype(np.int64), filled[order])
        words = np.frombuffer(bytes.fromhex(digest), np.uint32)
        random = np.random.default_rng([seed, *words.tolist()])
        key = random.random(len(order))
        order = order[np.lexsort((key, number[order]))]
        if weight == "attempt":
            first = _first_of_each(number[order])
            size = np.diff(np.r_[first, len(order)])
            kept = random.random(len(first)) < size / size.max(initial=1)
            order = order[first[kept]]
        self._probability, self._success = probability[order], success[order]
        self._number = number[order]

    def count(self, threshold: float) -> tuple[int, int]:
        """Return the number of drawn attempts at a threshold, and how many of them succeeded."""
        attempted, succeeded = attempts_at(threshold, self._probability, self._success)
        attempt = np.flatnonzero(attempted)
        drawn = attempt[_first_of_each(self._number[attempt])]
        return len(drawn), int(succeeded[drawn].sum())


def _first_of_each(number: Int[ndarray, " m"]) -> Int[ndarray, " k"]:
    """Return the first row of each run of equal numbers."""
    return np.flatnonzero(np.diff(number, prepend=-1))


@dataclass(frozen=True, eq=False)
class UnitShares:
    """The share of attempts and their success rate in each unit, at one threshold.

    Attributes
    ----------
    attempted
        Share of the unit's trials that are attempted, (units,).
    succeeded
        Share of these that succeed; NaN where none is attempted, (units,).
    size
        The unit's number of trials, relative to that of the largest unit, (units,).
    """

    attempted: Float[ndarray, " units"]
    succeeded: Float[ndarray, " units"]
    size: Float[ndarray, " units"]

    @classmethod
    def at(
        cls,
        threshold: float,
        probability: Forecasts,
        success: Outcomes,
        number: Int[ndarray, " n"],
    ) -> UnitShares:
        """Count attempts and successes by unit; units are numbered from 0, none left out."""
        attempted, successful = attempts_at(threshold, probability, success)
        size = np.bincount(number)
        attempts = np.bincount(number[attempted], minlength=len(size))
        successes = np.bincount(number[successful], minlength=len(size))
        succeeded = np.full(len(size), np.nan)
        np.divide(successes, attempts, out=succeeded, where=attempts > 0)
        return cls(attempts / size, succeeded, size / size.max())

    def expected_draws(self, weight: Weight) -> tuple[float, float]:
        """Return what :class:`UnitDraws` of such units yields on average.

        Returns
        -------
            The share of units with a drawn attempt, and the success rate of the drawn attempts (NaN
            without attempts).
        """
        some = ~np.isnan(self.succeeded)
        if not some.any():
            return 0.0, float("nan")
        if weight == "unit":
            return float(some.mean()), float(self.succeeded[some].mean())
        share = self.size * self.attempted
        succeeded = float((share[some] * self.succeeded[some]).sum() / share[some].sum())
        return float(share.mean()), succeeded
