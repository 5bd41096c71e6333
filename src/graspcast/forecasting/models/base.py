"""The interface of a model of grasp success."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from jaxtyping import Float
from numpy import ndarray

__all__ = ["Predictor"]


@runtime_checkable
class Predictor(Protocol):
    """A trained model of grasp success; objects are numbers from 0, -1 an unseen one."""

    def probability(
        self, features: Float[ndarray, "n d"], objects: ndarray
    ) -> Float[ndarray, " n"]:
        """Forecast the probability of success of each row."""
        ...

    def to_arrays(self) -> dict[str, ndarray]:
        """Return everything learned as named arrays."""
        ...
