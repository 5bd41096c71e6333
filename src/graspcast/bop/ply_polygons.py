"""Binary PLY files whose faces have different numbers of corners, rewritten with triangles."""

from __future__ import annotations

import struct
from dataclasses import dataclass

__all__ = ["with_triangles"]

_TYPES = {
    **dict.fromkeys(("char", "int8"), "b"),
    **dict.fromkeys(("uchar", "uint8"), "B"),
    **dict.fromkeys(("short", "int16"), "h"),
    **dict.fromkeys(("ushort", "uint16"), "H"),
    **dict.fromkeys(("int", "int32"), "i"),
    **dict.fromkeys(("uint", "uint32"), "I"),
    **dict.fromkeys(("float", "float32"), "f"),
    **dict.fromkeys(("double", "float64"), "d"),
}
_CORNERS = ("vertex_indices", "vertex_index")
_END = b"end_header"
_MOST = 10**8


@dataclass(frozen=True)
class _Property:
    """One property of an element: of a type, or a list whose length has a type of its own."""

    name: str
    kind: str
    count: str = ""


@dataclass
class _Element:
    name: str
    number: int
    properties: list[_Property]


def with_triangles(content: bytes) -> bytes | None:
    """Return a binary PLY file with every face as a fan of triangles.

    The colours of a face are those of its triangles; lists other than the corners are left out.

    Parameters
    ----------
    content
        The file.

    Returns
    -------
    The file with triangles; None if it is no binary PLY file with faces, or ends too early.
    """
    end = content.find(_END)
    begin = content.find(b"\n", end) + 1
    if end < 0 or begin == 0 or not content.startswith(b"ply"):
        return None
    try:
        order, elements = _parse_header(content[:end].decode("ascii"))
        return _rewritten(content, begin, order, elements)
    except (ValueError, KeyError, IndexError, struct.error):
        return None


def _parse_header(text: str) -> tuple[str, list[_Element]]:
    """Return the byte order and the elements; ValueError for what is not binary."""
    order, elements = "", list[_Element]()
    for line in text.splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            order = {"binary_little_endian": "<", "binary_big_endian": ">"}[words[1]]
        elif words[:1] == ["element"]:
            elements.append(_Element(words[1], int(words[2]), []))
        elif words[:2] == ["property", "list"]:
            kind, count = _TYPES[words[3]], _TYPES[words[2]]
            elements[-1].properties.append(_Property(words[4], kind, count))
        elif words[:1] == ["property"]:
            elements[-1].properties.append(_Property(words[2], _TYPES[words[1]]))
    if not order or any(e.number < 0 or e.number > _MOST for e in elements):
        raise ValueError
    return order, elements


def _rewritten(content: bytes, begin: int, order: str, elements: list[_Element]) -> bytes | None:
    lines, body, at, has_faces = ["ply", _format_line(order)], list[bytes](), begin, False
    for element in elements:
        fixed = all(not p.count for p in element.properties)
        if fixed:
            record = struct.calcsize(order + "".join(p.kind for p in element.properties))
            size = record * element.number
            if at + size > len(content):
                return None
            part, number, kept = content[at : at + size], element.number, element.properties
            at += size
        elif element.name == "face":
            has_faces = True
            part, number, at = _triangles(content, at, order, element)
            kept = [p for p in element.properties if not p.count]
        else:
            return None
        lines.append(f"element {element.name} {number}")
        if not fixed:
            lines.append("property list uchar int vertex_indices")
        lines += [f"property {_name_of(p.kind)} {p.name}" for p in kept]
        body.append(part)
    if not has_faces:
        return None
    return "\n".join([*lines, "end_header\n"]).encode("ascii") + b"".join(body)


def _format_line(order: str) -> str:
    return f"format binary_{'little' if order == '<' else 'big'}_endian 1.0"


def _name_of(kind: str) -> str:
    return next(name for name, letter in _TYPES.items() if letter == kind)


def _triangles(content: bytes, at: int, order: str, element: _Element) -> tuple[bytes, int, int]:
    """Return the triangles of the faces, their number, and where the faces end."""
    out = list[bytes]()
    scalar = struct.Struct(order + "".join(p.kind for p in element.properties if not p.count))
    corner = struct.Struct(f"{order}Biii")
    for _ in range(element.number):
        corners: tuple[int, ...] = ()
        values: list[float] = []
        for p in element.properties:
            if not p.count:
                values += struct.unpack_from(order + p.kind, content, at)
                at += struct.calcsize(order + p.kind)
                continue
            (length,) = struct.unpack_from(order + p.count, content, at)
            at += struct.calcsize(order + p.count)
            if length < 0:
                raise ValueError
            listed = struct.unpack_from(f"{order}{length}{p.kind}", content, at)
            at += struct.calcsize(f"{order}{length}{p.kind}")
            if p.name in _CORNERS:
                corners = listed
        rest = scalar.pack(*values)
        out += [
            corner.pack(3, corners[0], corners[i], corners[i + 1]) + rest
            for i in range(1, len(corners) - 1)
        ]
    return b"".join(out), len(out), at
