"""Out-of-fold predictions: forecasts of training instances by models fit without their scenes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

__all__ = ["OutOfFold"]


@dataclass(frozen=True, eq=False)
class OutOfFold:
    """Out-of-fold predictions with outcomes, for calibration and for ordering thresholds.

    Attributes
    ----------
    probability
        Calibrated forecasts, (m,).
    success
        Outcomes, (m,).
    image
        ``dataset/scene/image``, (m,).
    """

    probability: Float[ndarray, " m"]
    success: Bool[ndarray, " m"]
    image: ndarray

    def units(self, kind: str) -> ndarray:
        """Return the ``scene`` or ``image`` of each prediction."""
        if kind == "image":
            return self.image
        return np.array([name.rpartition("/")[0] for name in self.image.tolist()])

    def to_arrays(self) -> dict[str, ndarray]:
        """Return everything as named arrays."""
        return {f"out_of_fold/{f.name}": getattr(self, f.name) for f in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ndarray]) -> OutOfFold:
        """Restore what :meth:`to_arrays` returned; raise a ValueError if it is something else."""
        columns = [arrays[f"out_of_fold/{f.name}"] for f in fields(cls)]
        probability, success, image = columns
        if len({column.shape for column in columns}) > 1 or probability.ndim != 1:
            raise ValueError("the out-of-fold predictions have different lengths")
        if (probability.dtype.kind, success.dtype.kind, image.dtype.kind) != ("f", "b", "U"):
            raise ValueError("the out-of-fold predictions are not numbers, outcomes and names")
        return cls(probability, success, image)
