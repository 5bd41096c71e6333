"""A small network on crops, from an ONNX file, and an estimator around it."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.errors import FormatError, InputError, UnknownNameError
from graspcast.perception.crops import Crop, crop_of, cut
from graspcast.perception.estimator import Poses

if TYPE_CHECKING:
    from graspcast.bop.detections import Detections

__all__ = ["CropEstimator", "Network", "TrainedObject"]

_METADATA = "graspcast"
_LARGEST = 8
"""Boxes are amodal, so they reach beyond the image; a crop of one larger still shows nothing."""


@dataclass(frozen=True, eq=False)
class TrainedObject:
    """What a network has to know of an object that it was trained for; metres, object frame.

    Attributes
    ----------
    obj_id
        Its BOP number.
    diameter_m
        The largest distance between two of its points.
    lower, size
        Its bounding box.
    keypoints
        On its surface, (k, 3).
    """

    obj_id: int
    diameter_m: float
    lower: Float[ndarray, " 3"]
    size: Float[ndarray, " 3"]
    keypoints: Float[ndarray, "k 3"]


class Network:
    """A trained network.

    Parameters
    ----------
    family
        The estimator that it should be for.
    path
        The ONNX file; the one that ships if left out.

    Attributes
    ----------
    objects
        By BOP number, in the order of training.
    made
        What the training recorded: versions, configuration, seeds.

    Raises
    ------
    FormatError
        If the file is not there, is no network, or another estimator's.
    """

    def __init__(self, family: str, path: str | PathLike[str] | None = None):
        import onnxruntime

        self.path = Path(path or str(files("graspcast.perception") / "weights" / f"{family}.onnx"))
        try:
            content = self.path.read_bytes()
        except OSError as error:
            raise FormatError(self.path, f"cannot be read ({error.strerror})") from error
        options = onnxruntime.SessionOptions()
        # One thread: the same sums in the same order, and other processes keep theirs.
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        try:
            self._session: Any = onnxruntime.InferenceSession(
                content, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # onnxruntime has an exception for each of its own faults
            raise FormatError(
                self.path, f"is not an ONNX network that onnxruntime can run ({error})"
            ) from error
        try:
            about = json.loads(self._metadata())
            made_for = str(about["family"])
            self.pixels = int(about["pixels"])
            self.made: Mapping[str, Any] = dict(about["made"])
            self.objects = {entry["obj_id"]: _trained(entry) for entry in about["objects"]}
        except (KeyError, TypeError, ValueError) as error:
            raise FormatError(
                self.path, f"what training wrote into it is damaged ({error})"
            ) from error
        if made_for != family:
            raise FormatError(
                self.path, f"holds weights of the estimator {made_for}, not of {family}"
            )
        self._index = {obj_id: k for k, obj_id in enumerate(self.objects)}

    def __call__(self, crop: UInt8[ndarray, "s s 3"], obj_id: int) -> list[Float[ndarray, "..."]]:
        """The network's outputs for one crop in which an object is looked for."""
        image = np.ascontiguousarray(crop.transpose(2, 0, 1)[None], dtype=np.float32) / 255
        number = np.array([self._index[obj_id]], dtype=np.int64)
        try:
            outputs = self._session.run(None, {"image": image, "object": number})
        except Exception as error:  # as above
            raise FormatError(self.path, f"does not run ({error})") from error
        return [np.asarray(output[0], dtype=np.float64) for output in outputs]

    def _metadata(self) -> str:
        text: str | None = self._session.get_modelmeta().custom_metadata_map.get(_METADATA)
        if text is None:
            raise FormatError(
                self.path,
                "was not made by graspcast's training, which writes objects and sizes into it",
            )
        return text


def _trained(entry: Mapping[str, Any]) -> TrainedObject:
    return TrainedObject(
        int(entry["obj_id"]),
        float(entry["diameter_m"]),
        np.array(entry["lower"], dtype=np.float64).reshape(3),
        np.array(entry["size"], dtype=np.float64).reshape(3),
        np.array(entry["keypoints"], dtype=np.float64).reshape(-1, 3),
    )


class CropEstimator(ABC):
    """An estimator that looks at one detection at a time: a crop, a network, a pose.

    Parameters
    ----------
    weights
        An ONNX file; the one that ships if left out.
    """

    name: ClassVar[str]

    def __init__(self, weights: str | PathLike[str] | None = None):
        self.network = Network(self.name, weights)
        self.obj_ids = tuple(self.network.objects)

    def estimate(
        self, image: UInt8[ndarray, "h w 3"], K: Float[ndarray, "3 3"], detections: Detections
    ) -> Poses:
        """The pose of each detected object; see :class:`Estimator`."""
        self._check(image, K, detections)
        poses = np.tile(np.eye(4), (len(detections), 1, 1))
        scores = np.zeros(len(detections))
        for i, (obj_id, box) in enumerate(
            zip(detections.obj_id.tolist(), detections.box_xywh, strict=True)
        ):
            crop = crop_of(box)
            seen = self.network(cut(image, crop, self.network.pixels), obj_id)
            found = self.solve(seen, crop, K, self.network.objects[obj_id])
            if found is not None and np.isfinite(found[0]).all() and found[0][2, 3] > 0:
                poses[i], scores[i] = found
        return Poses(poses, scores)

    @abstractmethod
    def solve(
        self,
        outputs: list[Float[ndarray, "..."]],
        crop: Crop,
        K: Float[ndarray, "3 3"],
        trained: TrainedObject,
    ) -> tuple[Float[ndarray, "4 4"], float] | None:
        """``cam_T_obj`` and a score from what the network says of a crop; None if it says none."""

    def _check(self, image: ndarray, K: ndarray, detections: Detections) -> None:
        shape = np.shape(image)
        if image.dtype != np.uint8 or len(shape) != 3 or shape[2] != 3:
            what = "has an alpha channel" if len(shape) == 3 and shape[2] == 4 else "is"
            raise InputError(
                f"{self.name}: an RGB image of numbers from 0 to 255, (height, width, 3), is "
                f"needed; this one {what}: {image.dtype} {shape}"
            )
        if K.shape != (3, 3) or not np.isfinite(K).all() or min(K[0, 0], K[1, 1]) <= 0:
            raise InputError(f"{self.name}: K should be a camera's 3x3 matrix, not {K.tolist()}")
        for obj_id, box in zip(detections.obj_id.tolist(), detections.box_xywh, strict=True):
            if obj_id not in self.obj_ids:
                raise UnknownNameError(
                    "object", obj_id, self.obj_ids, hint=f"{self.network.path} has weights of these"
                )
            x, y, w, h = box
            if not (np.isfinite(box).all() and w > 0 and h > 0):
                raise InputError(f"{self.name}: the box {box.tolist()} of object {obj_id} is empty")
            if max(w, h) > _LARGEST * max(shape[:2]):
                raise InputError(
                    f"{self.name}: the box {box.tolist()} of object {obj_id} is more than "
                    f"{_LARGEST} times as large as the image; is it in pixels?"
                )
            if x >= shape[1] or y >= shape[0] or x + w <= 0 or y + h <= 0:
                raise InputError(
                    f"{self.name}: the box {box.tolist()} of object {obj_id} lies outside of the "
                    f"image, which has {shape[1]} x {shape[0]} pixels; was it made for another?"
                )
