"""Forecasts of a method under a protocol, with the outcomes of the grasps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.errors import FormatError, InputError, MismatchError
from graspcast.io.arrays import read_arrays, write_arrays

__all__ = ["Forecasts"]

_REMEDY = "delete it and start again"


@dataclass(frozen=True, eq=False)
class Forecasts:
    """Forecasts for one principal and gripper, with outcomes.

    Attributes
    ----------
    protocol
        What was left out of training (:data:`graspcast.evaluation.protocols.PROTOCOLS`).
    method
        Name of the method.
    principal, gripper
        Estimator that guided the grasps, and gripper.
    probability
        Forecast probability of success, (n,).
    success
        Outcomes, (n,).
    objects
        ``dataset-number`` of each, (n,).
    scenes
        Scene or block of frames of each, named by
        :func:`graspcast.estimates.instances.scene_groups`, (n,).

    Raises
    ------
    MismatchError
        If the columns differ in length.
    InputError
        If there is no row, or a value is not a probability.
    """

    protocol: str
    method: str
    principal: str
    gripper: str
    probability: Float[ndarray, " n"]
    success: Bool[ndarray, " n"]
    objects: ndarray
    scenes: ndarray

    def __post_init__(self) -> None:
        what = f"{self.method} ({self.protocol}, {self.principal}, {self.gripper})"
        columns = (self.probability, self.success, self.objects, self.scenes)
        shapes = [np.shape(column) for column in columns]
        if len(set(shapes)) > 1 or len(shapes[0]) != 1:
            raise MismatchError(
                f"{what}: probabilities, outcomes, objects and scenes are not columns of one "
                f"length, but {', '.join(map(str, shapes))}"
            )
        if not len(self.success):
            raise InputError(f"{what}: there are no predictions")
        wrong = ~((self.probability >= 0) & (self.probability <= 1))
        if wrong.any():
            raise InputError(
                f"{what}: {int(wrong.sum())} of {len(wrong)} predictions are no probabilities, the "
                f"first {self.probability[wrong][0]}"
            )

    def __len__(self) -> int:
        return len(self.success)

    def select(self, rows: Int[ndarray, " m"]) -> Forecasts:
        """Select forecasts, in the order of the rows.

        Raises
        ------
        InputError
            If there are none.
        """
        columns = ("probability", "success", "objects", "scenes")
        return replace(self, **{name: getattr(self, name)[rows] for name in columns})

    def save(self, path: str | PathLike[str], configuration: str) -> None:
        """Write an npz file atomically, with the configuration that the forecasts come from."""
        arrays = {name: np.asarray(value) for name, value in self.__dict__.items()}
        write_arrays(path, {"configuration": np.array(configuration), **arrays})

    @classmethod
    def load(cls, path: str | PathLike[str], configuration: str) -> Forecasts | None:
        """Read a file of :meth:`save`; None if there is none of this configuration.

        Raises
        ------
        FormatError
            If the file is not one of forecasts.
        """
        path = Path(path)
        if not path.exists():
            return None
        content = read_arrays(path, _REMEDY)
        try:
            if str(content["configuration"]) != configuration:
                return None
            names = ("protocol", "method", "principal", "gripper")
            columns = ("probability", "success", "objects", "scenes")
            named: dict[str, Any] = {n: str(content[n]) for n in names}
            return cls(**named, **{c: content[c] for c in columns})
        except Exception as error:  # those of zipfile, zlib and NumPy have no common base
            raise FormatError(
                path, f"is not a complete file of forecasts ({error}); {_REMEDY}"
            ) from error
