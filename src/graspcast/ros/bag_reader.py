"""Reading of bags: ROS 1 (.bag), ROS 2 in SQLite (.db3) and MCAP, without ROS."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any

from graspcast.errors import FormatError, InputError, UnknownNameError
from graspcast.io.extras import require
from graspcast.ros.bag_types import types_of

__all__ = ["MCAP", "ROS1", "SQLITE", "BagReader", "kind_of"]

ROS1, SQLITE, MCAP = "ROS 1", "SQLite", "MCAP"
_REMEDIES = {ROS1: "'rosbag reindex'", SQLITE: "'ros2 bag reindex'", MCAP: "'mcap recover'"}
_SUFFIXES = {".bag": ROS1, ".db3": SQLITE, ".mcap": MCAP}


def kind_of(path: str | PathLike[str]) -> str | None:
    """Return the kind of bag that a file's name stands for; None for a directory's."""
    return _SUFFIXES.get(Path(path).suffix.lower())


class BagReader:
    """An open bag; a context manager.

    Parameters
    ----------
    path
        A ``.bag``, ``.db3`` or ``.mcap`` file, or the directory of a ROS 2 bag.

    Attributes
    ----------
    kind
        ``ROS 1``, ``SQLite`` or ``MCAP``.
    connections
        Topics with their types; one topic may have several.

    Raises
    ------
    InputError
        For a path at which there is no bag.
    FormatError
        For a bag that is damaged, not indexed, or compressed in a way that cannot be read.
    ExtraMissingError
        Without the extra ``rosbag``.
    """

    def __init__(self, path: str | PathLike[str]):
        require("rosbag")
        self.path = Path(path)
        self.kind = self._kind()
        self.ros1 = self.kind == ROS1
        with self._damage("cannot be opened"):
            self._reader = self._open()
        self.connections: list[Any] = list(self._reader.connections)
        self._types: Any = None

    def _kind(self) -> str:
        if not self.path.exists():
            raise InputError(f"{self.path}: there is no such bag", parameters=("bag",))
        if self.path.is_dir():
            if not (self.path / "metadata.yaml").is_file():
                raise InputError(
                    f"{self.path}: is a directory without metadata.yaml, so it is no ROS 2 bag; "
                    "give a file in it (.db3, .mcap), or write the metadata anew with "
                    "'ros2 bag reindex'",
                    parameters=("bag",),
                )
            return MCAP if any(self.path.glob("*.mcap*")) else SQLITE
        if (kind := kind_of(self.path)) is None:
            known = ", ".join(_SUFFIXES)
            raise InputError(
                f"{self.path}: should be a {known} file, or the directory of a ROS 2 bag",
                parameters=("bag",),
            )
        return kind

    def _open(self) -> Any:
        from rosbags.rosbag1 import Reader as Reader1
        from rosbags.rosbag2 import Reader as Reader2

        reader = Reader1(self.path) if self.ros1 else Reader2(self.path)
        reader.open()
        return reader

    @contextmanager
    def _damage(self, what: str) -> Iterator[None]:
        """Turn what ``rosbags`` raises into one error; it raises many kinds on damaged files."""
        try:
            yield
        except InputError:
            raise
        except PermissionError as error:
            raise InputError(f"{self.path}: may not be read", parameters=("bag",)) from error
        except Exception as error:  # MemoryError, too: of a record that says it is so large
            said = (str(error) or type(error).__name__).splitlines()[0].rstrip(".")[:300]
            if isinstance(error, MemoryError):
                said = "a part of it says that it is larger than the memory"
            raise FormatError(
                self.path,
                f"{what}: {said}. The bag is damaged, was not closed, or is of an unknown kind; "
                f"{_REMEDIES[self.kind]} may mend it",
            ) from error

    def __enter__(self) -> BagReader:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._reader.close()

    def __len__(self) -> int:
        return int(self._reader.message_count)

    def topics(self) -> dict[str, str]:
        """Return the topics and their types, by name."""
        return {c.topic: c.msgtype for c in sorted(self.connections, key=lambda c: c.topic)}

    def connections_of(self, topic: str, types: Collection[str]) -> list[Any]:
        """Return the connections of a topic.

        Raises
        ------
        UnknownNameError
            For an unknown topic; the message lists those of the bag, with their types.
        InputError
            For a topic of another type.
        """
        found = [c for c in self.connections if c.topic == topic]
        if not found:
            known = [f"{name} ({kind})" for name, kind in self.topics().items()]
            near = get_close_matches(topic, list(self.topics()), n=1)
            hint = f"These are in {self.path}" + (f"; did you mean {near[0]}?" if near else "")
            raise UnknownNameError(
                "topic", topic, known, hint=hint, parameters=("topics", "estimates")
            )
        for connection in found:
            if connection.msgtype not in types:
                raise InputError(
                    f"{self.path}, topic {topic}: should be of type {' or '.join(types)}, but is "
                    f"{connection.msgtype}",
                    parameters=("topics", "estimates"),
                )
        return found

    def understand(self, connections: Collection[Any]) -> None:
        """Read the definitions of some topics, whose messages :meth:`read` then reads."""
        self._types = types_of(connections, self.path, ros1=self.ros1)

    def messages(self, connections: Collection[Any] = ()) -> Iterator[tuple[Any, int, bytes]]:
        """Yield connection, time in nanoseconds and content of the messages, by time.

        Raises
        ------
        FormatError
            Where the bag is damaged.
        """
        if not self.connections:
            return
        with self._damage("cannot be read"):
            yield from self._reader.messages(connections or self._reader.connections)

    def read(self, connection: Any, raw: bytes) -> Any:
        """Return a message.

        Raises
        ------
        FormatError
            For content that is not of the topic's type.
        """
        with self._damage(f"topic {connection.topic}: a message cannot be read"):
            if self.ros1:
                return self._types.deserialize_ros1(raw, connection.msgtype)
            return self._types.deserialize_cdr(raw, connection.msgtype)
