"""What can be inside a forecaster: a threshold on ADD, or ensembles of small networks."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from jaxtyping import Float
from numpy import ndarray

__all__ = ["Predictor"]


@runtime_checkable
class Predictor(Protocol):
    """What a forecaster needs; objects are numbers from 0."""

    def probability(self, features: Float[ndarray, "n d"], objects: ndarray) -> Float[ndarray, "n"]:
        """Probability of success of each row."""
        ...

    def to_arrays(self) -> dict[str, ndarray]:
        """Everything it has learned, as named arrays."""
        ...
