"""What a pose estimator is: an image, its camera and detections in; one pose a detection out."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.errors import UnknownNameError

if TYPE_CHECKING:
    from graspcast.bop.detections import Detections

__all__ = ["BUILT_IN", "Estimator", "Poses", "built_in"]

BUILT_IN = ("dense", "direct", "keypoints")
"""The estimators that come with graspcast, each of another family."""


@dataclass(frozen=True, eq=False)
class Poses:
    """One estimator's poses in one image, in the order of the detections.

    Attributes
    ----------
    cam_T_obj
        Rigid transforms in metres, (n, 4, 4). Where nothing was found it is the identity, the
        placeholder that readers of results drop and count.
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
        What it is called in results and tables.
    obj_ids
        The objects it has been trained for, by BOP number.
    """

    name: str
    obj_ids: tuple[int, ...]

    def estimate(
        self, image: UInt8[ndarray, "h w 3"], K: Float[ndarray, "3 3"], detections: Detections
    ) -> Poses:
        """The pose of each detected object.

        Parameters
        ----------
        image
            RGB, 0 to 255.
        K
            The camera's intrinsics, pixels; the middle of the first pixel is (0, 0).
        detections
            Those of this image alone; the order carries no meaning.

        Returns
        -------
            One pose a detection, in the same order.

        Raises
        ------
        InputError
            For an image of another kind, or a detection that is not in the image.
        UnknownNameError
            For an object that it does not know; the message lists the known.
        """
        ...


def built_in(name: str, weights: str | PathLike[str] | None = None) -> Estimator:
    """One of the estimators that come with graspcast.

    Parameters
    ----------
    name
        ``"dense"``, ``"direct"`` or ``"keypoints"``.
    weights
        An ONNX file that the training script has made; the one that ships, for the objects of the
        demonstration, if left out.

    Raises
    ------
    UnknownNameError
        For another name.
    FormatError
        If the weights cannot be read, or are another estimator's.
    """
    from importlib import import_module

    if name not in BUILT_IN:
        raise UnknownNameError("estimator", name, BUILT_IN)
    module = import_module(f"graspcast.perception.{name}")
    estimator: Estimator = module.load(weights)
    return estimator
