"""Judging of ROS messages: detections and transforms in, a verdict on each image out.

The node and the bag converter are this with a clock. Nothing here needs ROS.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from graspcast.errors import (
    GraspcastError,
    TransformNotYetError,
    UnknownEpisodeError,
    UnknownNameError,
)
from graspcast.ros.frames import frame_of
from graspcast.ros.poses import Stamp, seconds, stamp_of
from graspcast.ros.problems import Problems
from graspcast.ros.settings import SINGLE, Settings
from graspcast.ros.synchroniser import Synchronised, Synchroniser
from graspcast.ros.transform_buffer import TransformBuffer
from graspcast.runtime.answer import Answer
from graspcast.runtime.frame import Frame
from graspcast.runtime.watcher import Watcher

__all__ = ["Image", "Judged", "StreamJudge"]

_BACKWARDS_NS = 10_000_000_000
"""A stamp so much older than the latest one: the clock was set back, or a bag restarted."""


@dataclass(frozen=True, eq=False)
class Image:
    """One image before it is judged.

    Attributes
    ----------
    stamp
        Of the image, nanoseconds.
    frame
        What estimators found; None where it cannot be judged.
    missing
        Estimators that sent nothing in time.
    problems
        What was left out.
    """

    stamp: Stamp
    frame: Frame | None
    missing: Sequence[str]
    problems: Problems


@dataclass(frozen=True, eq=False)
class Judged:
    """One image, judged.

    Attributes
    ----------
    stamp
        Of the image, nanoseconds.
    answer
        None where it could not be judged; the problems say why.
    missing
        Estimators that sent nothing in time.
    problems
        What was left out.
    """

    stamp: Stamp
    answer: Answer | None
    missing: Sequence[str] = ()
    problems: Problems = field(default_factory=Problems)


class StreamJudge:
    """Judges images as messages of estimators and of tf come in.

    ::

        judge = StreamJudge(watcher, settings)
        judge.add_transforms(tf_message)
        judge.add_detections("epos", message, now)
        for judged in judge.due(now):
            publish(verdict_array(make, judged, settings))

    It is not thread-safe: one thread adds and asks.

    Parameters
    ----------
    watcher
        What judges frames. Its estimators are the streams.
    settings
        Frames, classes and tolerances.
    estimators
        Those that will send messages; all of the watcher's if None.

    Attributes
    ----------
    settings
        As given.
    objects
        Names of the objects that can be judged.
    problems
        All that was left out so far, counted.
    frames, judged
        How many images there were, and how many of them could be judged.
    """

    def __init__(
        self, watcher: Watcher, settings: Settings, estimators: Sequence[str] | None = None
    ):
        self.objects = frozenset(name for f in watcher.forecasters for name in f.card.objects)
        settings.check_objects(self.objects)
        for name in estimators or ():
            if name not in watcher.estimators:
                raise UnknownNameError(
                    "estimator", name, watcher.estimators, parameters=("topics", "estimates")
                )
        self._watcher, self.settings = watcher, settings
        self._transforms = TransformBuffer()
        self._synchroniser = Synchroniser(
            watcher.estimators if estimators is None else estimators,
            tolerance_s=settings.tolerance_s,
            timeout_s=settings.timeout_s,
        )
        self._waiting: list[Synchronised] = []
        self._episode: str | None = None
        self._latest: Stamp = 0
        self._problems = Problems()
        self.frames = self.judged = 0

    @property
    def problems(self) -> Problems:
        """All that was left out so far, counted."""
        out = Problems()
        for part in (self._synchroniser.problems, self._transforms.problems, self._problems):
            out.update(part)
        return out

    def clear(self) -> None:
        """Forget what waits, transforms that are not static, and the scene."""
        self._waiting.clear()
        self._synchroniser.clear()
        self._transforms.clear()
        self.new_scene()
        self._latest = 0

    def new_scene(self) -> None:
        """Begin a new scene: looks so far do not count for the next ones."""
        if self._episode is not None:
            with suppress(UnknownEpisodeError):  # it has expired
                self._watcher.forget(self._episode)
        self._episode = None

    def add_transforms(self, message: Any, *, static: bool = False) -> None:
        """Add a ``TFMessage``."""
        self._transforms.add_all(message.transforms, static=static)

    def add_detections(self, estimator: str, message: Any, now: Stamp) -> None:
        """Add an estimator's ``Detection3DArray``, which arrived at ``now``."""
        stamp = stamp_of(message.header)
        if stamp < self._latest - _BACKWARDS_NS:
            self._problems.add("stamp far in the past: what came before is forgotten", estimator)
            self.clear()
        self._latest = max(self._latest, stamp)
        self._synchroniser.add(estimator, stamp, message, now)

    def due(self, now: Stamp) -> list[Judged]:
        """Judge the images that are complete or have waited long enough, by stamp."""
        return self.judge(self.ready(now))

    def rest(self) -> list[Judged]:
        """Judge all that still waits, as at the end of a bag."""
        return self.judge(self.left())

    def ready(self, now: Stamp) -> list[Image]:
        """Return the images that :meth:`due` would judge, each once, for :meth:`judge`."""
        self._waiting += self._synchroniser.due(now)
        out = []
        while self._waiting:
            first = self._waiting[0]
            late = now - first.arrived >= 2 * round(self.settings.timeout_s * 1e9)
            image = self._image(first, final=late)
            if image is None:
                break
            out.append(image)
            del self._waiting[0]
        return out

    def left(self) -> list[Image]:
        """Return the images that :meth:`rest` would judge, for :meth:`judge`."""
        waiting = [*self._waiting, *self._synchroniser.rest()]
        self._waiting = []
        return [image for one in waiting if (image := self._image(one, final=True)) is not None]

    def judge(self, images: Sequence[Image]) -> list[Judged]:
        """Judge images; many single ones at once take less time each."""
        answers = self._answers([image.frame for image in images if image.frame is not None])
        out = []
        for image in images:
            answer = next(answers) if image.frame is not None else None
            if isinstance(answer, GraspcastError):
                image.problems.add("frame that could not be judged", str(answer))
                answer = None
            self._problems.update(image.problems)
            self.frames += 1
            self.judged += answer is not None
            out.append(Judged(image.stamp, answer, image.missing, image.problems))
        return out

    def _image(self, found: Synchronised, *, final: bool) -> Image | None:
        """Return an image's frame; None where a transform may still come."""
        try:
            frame, problems = frame_of(
                found.messages,
                found.stamp,
                self._transforms,
                self.settings,
                self.objects,
                final=final,
            )
        except TransformNotYetError:
            return None
        missing = self._synchroniser.missing(found)
        for name in missing:
            stamp = f"at {seconds(found.stamp):.3f} s"
            self._problems.add(f"image without a message by {name}", stamp)
        return Image(found.stamp, frame, missing, problems)

    def _answers(self, frames: Sequence[Frame]) -> Iterator[Answer | GraspcastError]:
        """Yield the watcher's answers: all at once, or look by look."""
        if self.settings.episodes == SINGLE:
            yield from self._watcher.judge_all(frames) if frames else ()
            return
        for frame in frames:
            try:
                answer = self._look(frame)
                self._episode = answer.episode
                yield answer
            except GraspcastError as error:
                yield error

    def _look(self, frame: Frame) -> Answer:
        try:
            return self._watcher.judge(frame, episode=self._episode)
        except UnknownEpisodeError:
            self._problems.add("scene that expired: a new one begins")
            return self._watcher.judge(frame)
