"""Frames from detections: ``vision_msgs`` of several estimators to the estimates of one image.

What is no sane estimate is left out, counted and named: nothing is attempted on it, and nothing is
guessed. Lengths are metres, as everywhere in ROS.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from graspcast.errors import InputError, TransformMissingError, TransformNotYetError
from graspcast.pose.sanity import is_placeholder
from graspcast.pose.transforms import compose
from graspcast.ros.poses import (
    PoseMessageError,
    Stamp,
    frame_name,
    matrix_of,
    seconds,
    stamp_of,
)
from graspcast.ros.problems import Problems
from graspcast.ros.settings import Settings
from graspcast.ros.transform_buffer import TransformBuffer
from graspcast.runtime.frame import Estimate, Frame

__all__ = ["frame_of"]

_DETECTIONS = "detections"


def frame_of(
    messages: Mapping[str, Any],
    stamp: Stamp,
    transforms: TransformBuffer,
    settings: Settings,
    known: frozenset[str],
    *,
    final: bool = True,
) -> tuple[Frame | None, Problems]:
    """Return the frame of one image, and what was left out of it.

    Parameters
    ----------
    messages
        Estimator's name to its ``Detection3DArray``. Of ROS 1 and older ROS 2, too.
    stamp
        Of the image, nanoseconds.
    transforms
        Where detections in another frame, and the camera in the world, are looked up.
    settings
        Frames and classes.
    known
        Names of the objects that can be judged.
    final
        Whether a transform that is not known yet counts as missing.

    Returns
    -------
    frame
        None where the camera's pose in the world is asked for and not known.
    problems
        What was left out.

    Raises
    ------
    TransformNotYetError
        Unless ``final``, where a transform may be known later.
    InputError
        For messages that are no detections.
    """
    problems = Problems()
    world_T_cam = None
    if settings.world_frame is not None:
        try:
            world_T_cam = transforms.lookup(settings.world_frame, settings.camera_frame, stamp)
        except TransformMissingError as error:
            _raise_if_early(error, final)
            problems.add("frame without the camera's pose in the world", str(error))
            return None, problems
    reader = _Reader(transforms, settings, known, problems, final)
    estimates = {name: reader.estimates(name, message) for name, message in messages.items()}
    return Frame(estimates=estimates, world_T_cam=world_T_cam, time_s=seconds(stamp)), problems


def _raise_if_early(error: TransformMissingError, final: bool) -> None:
    if isinstance(error, TransformNotYetError) and not final:
        raise error


class _LeftOutError(Exception):
    """A detection is left out; its arguments are the kind of problem, and the case."""


class _Reader:
    """Reads detections into estimates in the camera's frame."""

    def __init__(
        self,
        transforms: TransformBuffer,
        settings: Settings,
        known: frozenset[str],
        problems: Problems,
        final: bool,
    ):
        self._transforms, self._settings, self._known = transforms, settings, known
        self._problems, self._final = problems, final

    def estimates(self, name: str, message: Any) -> list[Estimate]:
        detections = getattr(message, _DETECTIONS, None)
        if detections is None:
            raise InputError(
                f"{name}: messages should be vision_msgs/Detection3DArray, not "
                f"{type(message).__name__}",
                parameters=("estimates",),
            )
        out = []
        for detection in detections:
            try:
                out.append(self._estimate(name, message.header, detection))
            except _LeftOutError as left_out:
                self._problems.add(*left_out.args)
        return out

    def _estimate(self, name: str, header: Any, detection: Any) -> Estimate:
        """Return one detection's estimate."""
        class_id, score, result = self._chosen(name, detection)
        of = f"{class_id!r} by {name}"
        object_name = self._settings.object_of(class_id, self._known)
        if object_name is None:
            raise _LeftOutError("estimate of an unknown class", of)
        frame = self._frame(header, detection)
        if frame is None:
            raise _LeftOutError("estimate whose frame contradicts that of its message", of)
        try:
            pose = matrix_of(result.pose.pose.position, result.pose.pose.orientation)
        except PoseMessageError as error:
            raise _LeftOutError(f"estimate with {error}", of) from error
        if is_placeholder(pose):
            raise _LeftOutError("estimate at its frame's origin: a placeholder", of)
        try:
            cam_T_frame = self._transforms.lookup(
                self._settings.camera_frame, frame, stamp_of(header)
            )
        except TransformMissingError as error:
            _raise_if_early(error, self._final)
            case = f"{of}: {error}"
            raise _LeftOutError("estimate without a transform to the camera", case) from error
        cam_T_obj = compose(cam_T_frame, pose)
        if cam_T_obj[2, 3] <= 0:
            hint = f"is {self._settings.camera_frame!r} the optical frame (z forward)?"
            raise _LeftOutError("estimate behind the camera", f"{of}: {hint}")
        return Estimate(object_name, cam_T_obj, score)

    def _chosen(self, name: str, detection: Any) -> tuple[str, float, Any]:
        """Return class, score and result of the likeliest hypothesis."""
        if not len(detection.results):
            raise _LeftOutError("detection without a hypothesis", f"by {name}")
        found = []
        for result in detection.results:
            hypothesis = getattr(result, "hypothesis", result)  # one level less in older messages
            class_id = hypothesis.class_id if hasattr(hypothesis, "class_id") else hypothesis.id
            found.append((str(class_id), float(hypothesis.score), result))
        if not all(math.isfinite(score) for _, score, _ in found):
            raise _LeftOutError("estimate with a score that is not finite", f"by {name}")
        return max(found, key=lambda one: one[1])

    def _frame(self, header: Any, detection: Any) -> str | None:
        """Return the frame of a detection; None where it and its message contradict."""
        outer = frame_name(header.frame_id)
        inner = frame_name(detection.header.frame_id) if hasattr(detection, "header") else ""
        return None if inner and outer and inner != outer else inner or outer
