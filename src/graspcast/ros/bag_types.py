"""Types of the messages in bags: definitions from the bag, or ours, and messages built of them.

``rosbags`` turns definitions into Python code. A bag is a file of others, so names in its
definitions are checked to be plain names first, and its constants are not used.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from graspcast.errors import FormatError
from graspcast.ros.definitions import (
    DETECTIONS,
    GRASPCAST_MSGS,
    TF2_MSGS,
    VISION_MSGS,
    VISION_MSGS_ROS1,
)
from graspcast.ros.outgoing import Maker

__all__ = ["maker_of", "own_types", "types_of"]

_TYPE_NAME = re.compile(r"[A-Za-z]\w{0,127}(/msg)?/[A-Za-z]\w{0,127}", re.ASCII)
_FIELD_NAME = re.compile(r"[A-Za-z_]\w{0,127}", re.ASCII)


def own_types(*, ros1: bool) -> Any:
    """Return the typestore of the messages that graspcast writes, and of those of ROS."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    definitions = {**(VISION_MSGS_ROS1 if ros1 else VISION_MSGS), **TF2_MSGS, **GRASPCAST_MSGS}
    parsed: dict[str, Any] = {}
    for name, text in definitions.items():
        parsed.update(get_types_from_msg(text, name))
    store.register(parsed)
    return store


def types_of(connections: Iterable[Any], path: object, *, ros1: bool) -> Any:
    """Return the typestore of some topics of a bag.

    Where the bag has no definitions, as ROS 2 wrote them before Iron, the published ones of these
    messages are used.

    Raises
    ------
    FormatError
        For definitions that cannot be read.
    """
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    parsed: dict[str, Any] = {}
    bare = False
    for connection in connections:
        definition = connection.msgdef
        try:
            if definition.format == MessageDefinitionFormat.MSG:
                parsed.update(get_types_from_msg(definition.data, connection.msgtype))
            elif definition.format == MessageDefinitionFormat.IDL:
                for text in _parts(definition.data):
                    parsed.update(get_types_from_idl(text))
            else:
                bare = True
        except Exception as error:  # of the parser, of several kinds
            raise FormatError(
                str(path),
                f"the definition of {connection.msgtype} cannot be read ({_first_line(error)})",
                where=f"topic {connection.topic}",
            ) from error
    if bare and not parsed:
        return own_types(ros1=ros1)
    _check_names(parsed, path)
    store = get_typestore(Stores.EMPTY)
    store.register({name: ([], fields) for name, (_, fields) in parsed.items()})
    return store


def _parts(text: str) -> list[str]:
    """Split several IDL definitions in one text, each after a line of ``=`` and its name."""
    separator = "=" * 80 + "\n"
    if not text.startswith(f"{separator}IDL: "):
        return [text]
    return [part.partition("\n")[2] for part in text.split(separator)[1:]]


def _check_names(parsed: dict[str, Any], path: object) -> None:
    for name, (_, fields) in parsed.items():
        odd = [field for field, _ in fields if not _FIELD_NAME.fullmatch(field)]
        odd += [] if _TYPE_NAME.fullmatch(name) else [name]
        odd += [n for _, kind in fields for n in _named(kind) if not _TYPE_NAME.fullmatch(n)]
        if odd:
            raise FormatError(
                str(path),
                f"the definition of {name[:100]!r} names {odd[0][:100]!r}, which is no name",
            )


def _named(kind: Any) -> list[str]:
    """Return the names of message types in a field's type."""
    from rosbags.interfaces import Nodetype

    tag, content = kind
    if tag == Nodetype.NAME:
        return [content]
    return [] if tag == Nodetype.BASE else _named(content[0])


def _first_line(error: BaseException) -> str:
    return (str(error) or type(error).__name__).splitlines()[0][:200]


def maker_of(store: Any, *, ros1: bool) -> Maker:
    """Return a maker of messages of :func:`own_types`."""

    def make(type_name: str, /, **fields: Any) -> Any:
        return store.types[type_name](**fields)

    return _in_ros1(make) if ros1 else make


def _in_ros1(make: Maker) -> Maker:
    """Return a maker that builds ROS 1's messages from the fields of ROS 2's."""
    import numpy as np

    def empty_cloud(header: Any) -> Any:
        return make(
            "sensor_msgs/msg/PointCloud2",
            header=header,
            height=0,
            width=0,
            fields=[],
            is_bigendian=False,
            point_step=0,
            row_step=0,
            data=np.zeros(0, dtype=np.uint8),
            is_dense=True,
        )

    def made(type_name: str, /, **fields: Any) -> Any:
        if type_name == "std_msgs/msg/Header":
            fields["seq"] = 0
        elif type_name == "vision_msgs/msg/ObjectHypothesis":
            return fields
        elif type_name == "vision_msgs/msg/ObjectHypothesisWithPose":
            hypothesis = fields.pop("hypothesis")
            fields |= {"id": int(hypothesis["class_id"]), "score": hypothesis["score"]}
        elif type_name == DETECTIONS.removesuffix("Array"):
            del fields["id"]
            fields["source_cloud"] = empty_cloud(fields["header"])
        return make(type_name, **fields)

    return made
