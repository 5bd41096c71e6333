"""Charts, read back."""

from __future__ import annotations

from xml.etree import ElementTree as ET


def texts(svg: str) -> list[str]:
    return [element.text or "" for element in ET.fromstring(svg).iter("text")]


def marks(svg: str, tag: str, kind: str) -> list[dict[str, float]]:
    """The numbers of the elements of a class."""
    found = [e for e in ET.fromstring(svg).iter(tag) if kind in (e.get("class") or "").split()]
    return [{k: float(v) for k, v in e.items() if k not in ("class", "points", "d")} for e in found]
