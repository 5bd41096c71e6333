"""Net benefit of attempting by a forecast, given the costs of a failure and of abstaining.

In units of the gain of a success, a failed attempt costs ``failure``, and not attempting costs
``abstention`` (another view, another object, a person's help). An attempt that succeeds with
probability p has the expected benefit p - (1 - p) failure, and abstaining -abstention. So
attempting is better from the break-even probability

    t = (failure - abstention) / (1 + failure)

on. With an abstention cost of 0 this is decision-curve analysis: its net benefit at threshold t,
TP/n - FP/n t/(1 - t), is the mean benefit per instance here, since t/(1 - t) is then the cost of a
failure.

Where an instance is looked at several times, every look after the first costs ``look``. It is paid
whether an attempt follows or not, so the break-even probability after the last look is the same.

References
----------
Vickers and Elkin (2006). Decision curve analysis: a novel method for evaluating prediction models.
Medical Decision Making 26(6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.errors import InputError

__all__ = ["Costs"]

_PARAMETERS = {"failure": "failure_cost", "abstention": "abstain_cost", "look": "look_cost"}


@dataclass(frozen=True)
class Costs:
    """Costs of outcomes, in units of the gain of a successful grasp.

    Attributes
    ----------
    failure
        Of an attempt that fails.
    abstention
        Of not attempting.
    look
        Of each look after the first.

    Raises
    ------
    InputError
        For a negative cost.
    """

    failure: float = 2.0
    abstention: float = 0.2
    look: float = 0.0

    def __post_init__(self) -> None:
        for name, parameter in _PARAMETERS.items():
            value = getattr(self, name)
            if not 0 <= value < np.inf:
                raise InputError(
                    f"the cost of a {name} should be 0 or more, in units of the gain of a success, "
                    f"not {value}",
                    parameters=(parameter,),
                )

    def __str__(self) -> str:
        return (
            f"failure {self.failure:g}, skip {self.abstention:g}, further look {self.look:g} "
            "(a success gains 1)"
        )

    @property
    def break_even(self) -> float:
        """The probability from which attempting is better than abstaining, from 0 to 1."""
        return max(0.0, (self.failure - self.abstention) / (1.0 + self.failure))

    def of_one_look(self) -> dict[str, float]:
        """Return the costs that matter with one look, and the break-even probability, for JSON."""
        return {
            "failure": self.failure,
            "abstention": self.abstention,
            "break_even": self.break_even,
        }

    def net_benefit(
        self, attempt: Bool[ndarray, " n"], success: Bool[ndarray, " n"]
    ) -> Float[ndarray, " n"]:
        """Return the net benefit of each instance, given which are attempted."""
        return np.where(attempt, np.where(success, 1.0, -self.failure), -self.abstention)

    def net_benefit_of_forecast(
        self, probability: Float[ndarray, " n"], success: Bool[ndarray, " n"]
    ) -> Float[ndarray, " n"]:
        """Return the net benefit of each instance, if attempted from the break-even probability."""
        return self.net_benefit(probability >= self.break_even, success)

    def references(self, success: Bool[ndarray, " n"]) -> dict[str, Float[ndarray, " n"]]:
        """Return the net benefit of attempting ``always``, ``never``, and by ``perfect`` forecasts.

        Each is that of each instance, (n,).
        """
        everything = np.ones_like(success)
        return {
            "always": self.net_benefit(everything, success),
            "never": self.net_benefit(~everything, success),
            "perfect": self.net_benefit_of_forecast(success.astype(np.float64), success),
        }
