"""Writing of bags: ROS 1 (.bag), ROS 2 in SQLite (.db3) and MCAP, whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from graspcast.errors import InputError
from graspcast.io.files import check_target, temporary_directory
from graspcast.ros.bag_reader import MCAP, ROS1, BagReader, kind_of
from graspcast.ros.bag_types import own_types

__all__ = ["BagWriter", "check_output", "written_kind"]

_VERSION: Literal[8] = 8
"""Of the metadata of ROS 2's bags; read by Humble and later."""
_NO_HASH = "RIHS01_" + "0" * 64


def written_kind(out: str | PathLike[str], read: str) -> str:
    """Return the kind of bag to write: by the name of the file, or as the one that is read.

    Raises
    ------
    InputError
        For ROS 1 from ROS 2 or the other way round, whose messages differ.
    """
    kind = kind_of(out) or read
    if (kind == ROS1) != (read == ROS1):
        raise InputError(
            f"{out}: messages of ROS 1 and ROS 2 differ, and are not converted here; name a "
            f"{'.bag file' if read == ROS1 else '.db3 or .mcap file, or a directory'}, or convert "
            "the bag first (rosbags-convert)",
            parameters=("out",),
        )
    if kind == ROS1 and kind_of(out) is None:
        raise InputError(f"{out}: a ROS 1 bag is a file that ends in .bag", parameters=("out",))
    return kind


def check_output(out: str | PathLike[str], read: Path) -> None:
    """Raise where a bag cannot be written.

    Raises
    ------
    InputError
        For the bag that is read, a directory that exists, or a file that cannot be made.
    """
    target = Path(out)
    if target.resolve() == read.resolve() or read.resolve() in target.resolve().parents:
        raise InputError(f"{out}: is the bag that is read; write to another", parameters=("out",))
    if kind_of(target) is None:
        if target.exists():
            raise InputError(
                f"{out}: exists; a directory is not replaced: remove it or name another one",
                parameters=("out",),
            )
        check_target(target)
        return
    check_target(target)


class BagWriter:
    """Writes a bag beside its place, and puts it there when all is written.

    ::

        with BagWriter.open("out.mcap", MCAP) as writer:
            topic = writer.add_topic("/verdicts", VERDICTS)
            writer.write_message(topic, time_ns, message)
    """

    def __init__(self, writer: Any, kind: str):
        self._writer, self.ros1 = writer, kind == ROS1
        self.types = own_types(ros1=self.ros1)
        self._copied: dict[int, Any] = {}

    @classmethod
    @contextmanager
    def open(cls, out: str | PathLike[str], kind: str) -> Iterator[BagWriter]:
        """Yield a writer; put the bag in place if the block succeeds.

        Raises
        ------
        InputError
            If it cannot be written, or the disk is full.
        """
        target = Path(out).absolute()
        with temporary_directory(target.parent) as beside:
            single = kind_of(target) is not None
            place = beside / (target.stem if single and kind != ROS1 else target.name)
            with _storage_errors(target):
                with _writer(place, kind) as writer:
                    yield cls(writer, kind)
                if single and kind != ROS1:
                    place = next(path for path in place.iterdir() if path.suffix != ".yaml")
                place.rename(target)

    def copy_topics(self, reader: BagReader) -> None:
        """Add the topics of a bag, with their definitions, so that messages can be copied."""
        known: dict[Any, Any] = {}
        for connection in reader.connections:
            key = connection.topic, connection.msgtype, str(connection.ext)
            if key not in known:
                known[key] = self._add_copy(connection)
            self._copied[connection.id] = known[key]

    def _add_copy(self, connection: Any) -> Any:
        common = {"msgdef": connection.msgdef.data}
        if self.ros1:
            return self._writer.add_connection(
                connection.topic,
                connection.msgtype,
                md5sum=connection.digest,
                callerid=connection.ext.callerid,
                latching=connection.ext.latching,
                **common,
            )
        return self._writer.add_connection(
            connection.topic,
            connection.msgtype,
            rihs01=connection.digest or _NO_HASH,
            serialization_format=connection.ext.serialization_format,
            offered_qos_profiles=connection.ext.offered_qos_profiles,
            **common,
        )

    def copy(self, connection: Any, time_ns: int, raw: bytes) -> None:
        """Write a message of the bag whose topics were copied, as it is."""
        self._writer.write(self._copied[connection.id], time_ns, raw)

    def add_topic(self, topic: str, type_name: str) -> Any:
        """Add a topic of one of our types, or of ROS's."""
        return self._writer.add_connection(topic, type_name, typestore=self.types)

    def write_message(self, topic: Any, time_ns: int, message: Any) -> None:
        """Write a message of :attr:`types`."""
        serialize = self.types.serialize_ros1 if self.ros1 else self.types.serialize_cdr
        self._writer.write(topic, time_ns, serialize(message, topic.msgtype))


@contextmanager
def _storage_errors(target: Path) -> Iterator[None]:
    """Turn errors of SQLite, which writes ROS 2's bags, into ours."""
    import sqlite3

    try:
        yield
    except sqlite3.Error as error:
        raise InputError(f"{target}: could not be written ({error})") from error
    except OSError as error:
        raise InputError(f"{target}: could not be written ({error.strerror or error})") from error


def _writer(place: Path, kind: str) -> Any:
    if kind == ROS1:
        from rosbags.rosbag1 import Writer

        return Writer(place)
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2

    plugin = StoragePlugin.MCAP if kind == MCAP else StoragePlugin.SQLITE3
    return Writer2(place, version=_VERSION, storage_plugin=plugin)
