"""What following verdicts is worth, given what a failure costs and what it costs to abstain.

In units of what a success gains, a failed attempt costs ``failure``, and not attempting costs
``abstention`` (another view, another object, a person's help). An attempt that succeeds with
probability p is worth p - (1 - p) failure, and abstaining is worth -abstention; so attempting pays
from the break-even probability

    t = (failure - abstention) / (1 + failure)

on. With free abstention this is decision-curve analysis (Vickers & Elkin, *Decision Curve
Analysis*, Medical Decision Making 2006): its net benefit at threshold t, TP/n - FP/n t/(1 - t), is
the value per instance here, since t/(1 - t) is then the cost of a failure.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.errors import InputError

__all__ = ["Costs"]


@dataclass(frozen=True)
class Costs:
    """Costs in units of what a successful grasp gains.

    Attributes
    ----------
    failure
        Of an attempt that fails.
    abstention
        Of not attempting.

    Raises
    ------
    InputError
        For a negative cost.
    """

    failure: float = 2.0
    abstention: float = 0.2

    def __post_init__(self) -> None:
        for name in ("failure", "abstention"):
            value = getattr(self, name)
            if not 0 <= value < np.inf:
                raise InputError(
                    f"the cost of a {name} should be 0 or more, in units of what a success gains, "
                    f"not {value}"
                )

    @property
    def break_even(self) -> float:
        """The probability from which attempting is worth more than abstaining, from 0 to 1."""
        return max(0.0, (self.failure - self.abstention) / (1.0 + self.failure))

    def value(
        self, attempt: Bool[ndarray, " n"], success: Bool[ndarray, " n"]
    ) -> Float[ndarray, " n"]:
        """The value of each instance, if these are attempted."""
        return np.where(attempt, np.where(success, 1.0, -self.failure), -self.abstention)

    def following(
        self, probability: Float[ndarray, " n"], success: Bool[ndarray, " n"]
    ) -> Float[ndarray, " n"]:
        """The value of each instance, if attempts are made from the break-even probability on."""
        return self.value(probability >= self.break_even, success)

    def references(self, success: Bool[ndarray, " n"]) -> dict[str, Float[ndarray, " n"]]:
        """The value of each instance if ``always``, ``never``, and by a ``perfect`` forecaster."""
        everything = np.ones_like(success)
        return {
            "always": self.value(everything, success),
            "never": self.value(~everything, success),
            "perfect": self.following(success.astype(np.float64), success),
        }
