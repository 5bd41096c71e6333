"""Conversion of bags: yesterday's bag, with the verdicts on its frames in it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from typing import Any

from graspcast.errors import FormatError, InputError
from graspcast.io.progress import Progress
from graspcast.ros.bag_reader import BagReader
from graspcast.ros.bag_types import maker_of
from graspcast.ros.bag_writer import BagWriter, check_output, written_kind
from graspcast.ros.definitions import DETECTIONS, TRANSFORMS, VERDICTS
from graspcast.ros.judging import Image, Judged, StreamJudge
from graspcast.ros.outgoing import detection_array, verdict_array
from graspcast.ros.problems import Problems
from graspcast.ros.settings import Settings
from graspcast.runtime.watcher import Watcher

__all__ = ["PREFIX", "Converted", "convert_bag"]

PREFIX = "/graspcast"
_TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
_TF, _TF_STATIC = "/tf", "/tf_static"
_OLD_TRANSFORMS = "tf/msg/tfMessage"
"""Of ROS 1 before tf2."""
_BATCH = 16
"""Images that are judged at once."""
_REPORTED_EVERY = 200
"""Messages between two reports of progress."""


@dataclass
class Converted:
    """What a conversion did.

    Attributes
    ----------
    kind
        Of the bag that was written.
    messages
        Messages that were copied.
    frames, judged
        Images of which there were estimates, and those that could be judged.
    actions
        Action to the number of decisions.
    problems
        What was left out, counted.
    """

    kind: str
    messages: int = 0
    frames: int = 0
    judged: int = 0
    actions: Counter[str] = field(default_factory=Counter)
    problems: Problems = field(default_factory=Problems)


def convert_bag(
    bag: str | PathLike[str],
    out: str | PathLike[str],
    watcher: Watcher,
    topics: Mapping[str, str],
    settings: Settings,
    *,
    prefix: str = PREFIX,
    progress: Progress | None = None,
) -> Converted:
    """Write a bag with all messages of another and the verdicts on its frames.

    The verdicts carry the stamps of their images. Their time in the bag is that of the message
    with which the frame was complete, so that played back they come after what they were made of.
    Memory does not grow with the messages, but for the index of the bag.

    Parameters
    ----------
    bag
        The bag to read.
    out
        The bag to write: a ``.bag``, ``.db3`` or ``.mcap`` file, or a directory, which gets the
        format of the bag that is read.
    watcher
        What judges frames.
    topics
        Estimator's name to the topic of its ``vision_msgs/Detection3DArray``.
    settings
        Frames, classes and tolerances.
    prefix
        Of the topics ``verdicts`` and ``detections`` that are added.
    progress
        Called with the share done.

    Raises
    ------
    UnknownNameError
        For a topic that the bag does not have, or an estimator or object that the watcher does not
        know.
    InputError
        For topics of another type, and where the bag cannot be written.
    FormatError
        For a damaged bag; nothing is written then.
    """
    with BagReader(bag) as reader:
        kind = written_kind(out, reader.kind)
        check_output(out, reader.path)
        conversion = _Conversion(reader, watcher, topics, settings, prefix)
        with BagWriter.open(out, kind) as writer:
            return conversion.run(writer, Converted(kind), progress)


class _Conversion:
    """One conversion: the messages in order, judged as they come."""

    def __init__(
        self,
        reader: BagReader,
        watcher: Watcher,
        topics: Mapping[str, str],
        settings: Settings,
        prefix: str,
    ):
        self._reader, self._settings = reader, settings
        self._judge = StreamJudge(watcher, settings, tuple(topics))
        self._estimators: dict[int, str] = {}
        used = []
        for name, topic in topics.items():
            for connection in reader.connections_of(topic, (DETECTIONS,)):
                if connection.id in self._estimators:
                    raise InputError(
                        f"the topic {topic} is given for {self._estimators[connection.id]} and for "
                        f"{name}; estimators have topics of their own",
                        parameters=("topics", "estimates"),
                    )
                self._estimators[connection.id] = name
                used.append(connection)
        self._moving, self._static = self._transforms(_TF), self._transforms(_TF_STATIC)
        reader.understand([*used, *self._moving, *self._static])
        self._names = [f"{prefix.rstrip('/')}/{name}" for name in ("verdicts", "detections")]
        self._check_names(prefix)

    def _transforms(self, topic: str) -> list[Any]:
        if topic not in self._reader.topics():
            return []
        return self._reader.connections_of(topic, (TRANSFORMS, _OLD_TRANSFORMS))

    def _check_names(self, prefix: str) -> None:
        if not all(_TOPIC.fullmatch(name) for name in self._names):
            raise InputError(
                "the prefix of topics is as /graspcast, of letters, digits, _ and /, not "
                f"{prefix!r}",
                parameters=("prefix",),
            )
        present = [name for name in self._names if name in self._reader.topics()]
        if present:
            raise InputError(
                f"{self._reader.path}: has the topic {present[0]} already; choose another prefix "
                f"than {prefix}",
                parameters=("prefix",),
            )
        if self._reader.ros1:
            for name in self._settings.objects:
                if not name.lstrip("-").isdigit():
                    raise InputError(
                        f"in ROS 1 classes are whole numbers, not {name!r}", parameters=("objects",)
                    )

    def run(self, writer: BagWriter, done: Converted, progress: Progress | None) -> Converted:
        """Copy all messages, and write the verdicts between them."""
        self._writer, self._done = writer, done
        self._make = maker_of(writer.types, ros1=writer.ros1)
        writer.copy_topics(self._reader)
        self._topics = [
            writer.add_topic(name, kind)
            for name, kind in zip(self._names, (VERDICTS, DETECTIONS), strict=True)
        ]
        self._read_static()
        self._later: list[tuple[Image, int]] = []
        total, time_ns = max(len(self._reader), 1), 0
        moving = {connection.id for connection in self._moving}
        for connection, time_ns, raw in self._reader.messages():
            writer.copy(connection, time_ns, raw)
            done.messages += 1
            if connection.id in moving:
                self._add(connection, raw)
            elif connection.id in self._estimators:
                self._add(connection, raw, self._estimators[connection.id], time_ns)
            self._later += [(image, time_ns) for image in self._judge.ready(time_ns)]
            if len(self._later) >= _BATCH:
                self._write_later()
            if progress is not None and done.messages % _REPORTED_EVERY == 0:
                progress(min(done.messages / total, 1.0), "")
        self._later += [(image, time_ns) for image in self._judge.left()]
        self._write_later()
        done.frames, done.judged = self._judge.frames, self._judge.judged
        done.problems.update(self._judge.problems)
        return done

    def _read_static(self) -> None:
        """Read the static transforms, which hold at all times, wherever in the bag they are."""
        if self._static:
            for connection, _, raw in self._reader.messages(self._static):
                self._add(connection, raw, static=True)

    def _add(
        self,
        connection: Any,
        raw: bytes,
        estimator: str | None = None,
        time_ns: int = 0,
        *,
        static: bool = False,
    ) -> None:
        """Add a message to the judge; one that cannot be read is counted."""
        try:
            message = self._reader.read(connection, raw)
        except FormatError as error:
            self._done.problems.add("message that cannot be read", error.problem)
            return
        if estimator is None:
            self._judge.add_transforms(message, static=static)
        else:
            self._judge.add_detections(estimator, message, time_ns)

    def _write_later(self) -> None:
        """Judge the images that wait, at once, and write the verdicts."""
        judged = self._judge.judge([image for image, _ in self._later])
        for one, (_, time_ns) in zip(judged, self._later, strict=True):
            self._write(one, time_ns)
        self._later = []

    def _write(self, judged: Judged, time_ns: int) -> None:
        verdicts = verdict_array(self._make, judged, self._settings)
        detections = detection_array(self._make, judged, self._settings)
        for topic, message in zip(self._topics, (verdicts, detections), strict=True):
            self._writer.write_message(topic, time_ns, message)
        if judged.answer is not None:
            self._done.actions.update(decision.action for decision in judged.answer.decisions)
            for decision in judged.answer.decisions:
                if decision.instance < 0:
                    case = f"{decision.object_name}: {decision.reason}"
                    self._done.problems.add("object without a pose that can be", case)
