"""The interface of a pose estimator, and the built-in estimators by name."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.errors import UnknownNameError
from graspcast.io.arguments import NAME, PATH, checked

if TYPE_CHECKING:
    from graspcast.bop.detections import Detections

__all__ = ["BUILT_IN", "Estimator", "Poses", "built_in"]

_CLASSES = {
    "dense": "DenseEstimator",
    "direct": "DirectEstimator",
    "keypoints": "KeypointEstimator",
}
BUILT_IN = tuple(_CLASSES)
"""Names of the built-in estimators."""


@dataclass(frozen=True, eq=False)
class Poses:
    """One estimator's poses in one image, in the order of the detections.

    Attributes
    ----------
    cam_T_obj
        Rigid transforms in metres, (n, 4, 4). The identity means "nothing found"; readers of
        results drop and count these placeholders.
    score
        The estimator's own confidence in [0, 1], (n,); 0 where nothing was found.
    """

    cam_T_obj: Float[ndarray, "n 4 4"]
    score: Float[ndarray, " n"]

    def __len__(self) -> int:
        return len(self.score)


@runtime_checkable
class Estimator(Protocol):
    """A pose estimator from RGB, given 2D detections.

    Attributes
    ----------
    name
        Its name in results and tables.
    obj_ids
        BOP ids of the objects that it was trained for.
    """

    name: str
    obj_ids: tuple[int, ...]

    def estimate(
        self, image: UInt8[ndarray, "h w 3"], K: Float[ndarray, "3 3"], detections: Detections
    ) -> Poses:
        """Estimate the pose of each detected object.

        Parameters
        ----------
        image
            RGB, 0 to 255.
        K
            The camera's intrinsics, pixels; the middle of the first pixel is (0, 0).
        detections
            The detections of this image, in any order.

        Returns
        -------
            One pose per detection, in the same order.

        Raises
        ------
        InputError
            If the image is not RGB, or a detection lies outside of it.
        UnknownNameError
            For an object that it does not know; the message lists the known ones.
        """
        ...


@checked(name=NAME, weights=PATH)
def built_in(name: str, weights: str | PathLike[str] | None = None) -> Estimator:
    """Load a built-in estimator.

    Parameters
    ----------
    name
        ``"dense"``, ``"direct"`` or ``"keypoints"``.
    weights
        An ONNX file written by :mod:`graspcast.training`; by default the file in the package,
        for the objects of the demonstration dataset.

    Raises
    ------
    UnknownNameError
        If there is no built-in estimator of this name.
    FormatError
        If the weights cannot be read, or belong to another estimator.
    """
    from importlib import import_module

    if name not in BUILT_IN:
        raise UnknownNameError("estimator", name, BUILT_IN)
    module = import_module(f"graspcast.perception.{name}")
    estimator: Estimator = getattr(module, _CLASSES[name])(weights)
    return estimator
