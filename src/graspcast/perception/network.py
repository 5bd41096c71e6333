"""Networks that take crops, from ONNX files, and the base class of estimators that use them."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.errors import FormatError, InputError, UnknownNameError
from graspcast.io.reading import read_bytes
from graspcast.perception.crops import Crop, crop_around_box, resample
from graspcast.perception.estimator import Poses
from graspcast.perception.trained_objects import TrainedObject, TrainedObjects

if TYPE_CHECKING:
    from graspcast.bop.detections import Detections

__all__ = ["METADATA", "CropEstimator", "Network"]

METADATA = "graspcast"
"""Key of the metadata of an ONNX file, under which graspcast keeps its own, as JSON."""
_LARGEST = 8
"""The largest box that is accepted, as a multiple of the image's longer side.

Boxes are amodal, so they may extend beyond the image.
"""


class Network:
    """A trained network, run on the CPU by ONNX Runtime.

    Parameters
    ----------
    family
        The name of the estimator that it is for.
    path
        The ONNX file; by default the one in the package.

    Attributes
    ----------
    trained
        The dataset that it was trained for, and that dataset's objects.
    objects
        The trained objects by BOP id, in the order of training.
    made
        Metadata from training: versions, configuration, seeds.
    validation
        Errors on rendered images held out of training, by object; empty if they are not known.

    Raises
    ------
    FormatError
        If the file is missing, is not a network, or belongs to another estimator.
    """

    def __init__(self, family: str, path: str | PathLike[str] | None = None):
        import onnxruntime

        self.path = Path(path or str(files("graspcast.perception") / "weights" / f"{family}.onnx"))
        content = read_bytes(self.path)
        options = onnxruntime.SessionOptions()
        # One thread: sums are in a fixed order, and other processes are not slowed down.
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        try:
            self._session: Any = onnxruntime.InferenceSession(
                content, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # onnxruntime has many exception types
            raise FormatError(
                self.path, f"is not an ONNX network that onnxruntime can run ({error})"
            ) from error
        try:
            about = json.loads(self._metadata())
            made_for = str(about["family"])
            self.pixels = int(about["pixels"])
            self.made: Mapping[str, Any] = dict(about["made"])
            self.validation: Mapping[str, Any] = dict(about.get("validation", {}))
            objects = [TrainedObject.from_metadata(entry) for entry in about["objects"]]
            dataset = about.get("dataset")
            if not isinstance(dataset, str | None):
                raise TypeError(f"its dataset is {dataset!r}")
        except (KeyError, TypeError, ValueError) as error:
            raise FormatError(self.path, f"its metadata are damaged ({error})") from error
        if made_for != family:
            raise FormatError(self.path, f"holds weights of the estimator {made_for}, not {family}")
        self.trained = TrainedObjects(str(self.path), dataset, {o.obj_id: o for o in objects})
        self.objects = self.trained.by_id
        self._index = {obj_id: k for k, obj_id in enumerate(self.objects)}

    def __call__(self, crop: UInt8[ndarray, "s s 3"], obj_id: int) -> list[Float[ndarray, "..."]]:
        """Run the network on one crop, for the object with a BOP id."""
        image = np.ascontiguousarray(crop.transpose(2, 0, 1)[None], dtype=np.float32) / 255
        number = np.array([self._index[obj_id]], dtype=np.int64)
        try:
            outputs = self._session.run(None, {"image": image, "object": number})
        except Exception as error:  # as above
            raise FormatError(self.path, f"does not run ({error})") from error
        return [np.asarray(output[0], dtype=np.float64) for output in outputs]

    def _metadata(self) -> str:
        text: str | None = self._session.get_modelmeta().custom_metadata_map.get(METADATA)
        if text is None:
            raise FormatError(
                self.path,
                "was not written by graspcast's training: it lacks the metadata on objects",
            )
        return text


class CropEstimator(ABC):
    """Base class of estimators that crop each detection and run a network on it.

    Parameters
    ----------
    weights
        An ONNX file; by default the one in the package.
    """

    name: ClassVar[str]

    def __init__(self, weights: str | PathLike[str] | None = None):
        self.network = Network(self.name, weights)
        self.obj_ids = tuple(self.network.objects)

    def estimate(
        self, image: UInt8[ndarray, "h w 3"], K: Float[ndarray, "3 3"], detections: Detections
    ) -> Poses:
        """Estimate the pose of each detected object; see :class:`Estimator`."""
        self._check(image, K, detections)
        poses = np.tile(np.eye(4), (len(detections), 1, 1))
        scores = np.zeros(len(detections))
        for i, (obj_id, box) in enumerate(
            zip(detections.obj_id.tolist(), detections.box_xywh, strict=True)
        ):
            crop = crop_around_box(box)
            outputs = self.network(resample(image, crop, self.network.pixels), obj_id)
            found = self.solve(outputs, crop, K, self.network.objects[obj_id])
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
        """Compute ``cam_T_obj`` and a score from the network's outputs; None for no pose."""

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
                    "object",
                    obj_id,
                    self.obj_ids,
                    hint=f"{self.network.path} was trained for these",
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
