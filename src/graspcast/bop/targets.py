"""Targets of the BOP Challenge: the images and objects that estimates are wanted of."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike

from graspcast.io.json import identifier, read_json, require

__all__ = ["Target", "read_targets"]


@dataclass(frozen=True)
class Target:
    """One entry of a targets file; ``obj_id`` and ``inst_count`` are None in the bop24 format."""

    scene_id: int
    im_id: int
    obj_id: int | None = None
    inst_count: int | None = None


def read_targets(path: str | PathLike[str]) -> list[Target]:
    """Read a targets file in the format bop19 (image, object, count) or bop24 (image only).

    Raises
    ------
    FormatError
        Naming the entry and the key.
    """
    out = []
    for i, entry in enumerate(read_json(path, list)):
        where = f"entry {i}"
        scene_id = identifier(require(entry, "scene_id", path, where), path, where)
        im_id = identifier(require(entry, "im_id", path, where), path, where)
        if "obj_id" not in entry:
            out.append(Target(scene_id, im_id))
            continue
        obj_id = identifier(entry["obj_id"], path, where)
        count = identifier(require(entry, "inst_count", path, where), path, where)
        out.append(Target(scene_id, im_id, obj_id, count))
    return out
