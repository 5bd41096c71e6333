"""Forecasts of training instances by forests that had not seen their scenes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

__all__ = ["OutOfFold"]


@dataclass(frozen=True, eq=False)
class OutOfFold:
    """What calibration was learned from; a promise's thresholds are put in order by it.

    Attributes
    ----------
    probability
        Calibrated, (m,).
    success
        Outcomes, (m,).
    image
        ``dataset/scene/image``, (m,).
    """

    probability: Float[ndarray, "m"]
    success: Bool[ndarray, "m"]
    image: ndarray

    def units(self, kind: str) -> ndarray:
        """Each one's ``scene`` or ``image``."""
        if kind == "image":
            return self.image
        return np.array([name.rpartition("/")[0] for name in self.image.tolist()])

    def to_arrays(self) -> dict[str, ndarray]:
        """Named arrays."""
        return {f"out_of_fold/{f.name}": getattr(self, f.name) for f in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ndarray]) -> OutOfFold:
        """The inverse of :meth:`to_arrays`."""
        return cls(*(arrays[f"out_of_fold/{f.name}"] for f in fields(cls)))
