"""Files of detections as several projects keep them, as entries of the BOP Challenge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path, PurePath
from typing import Any

from graspcast.errors import FormatError
from graspcast.io.json import identifier, read_json, require

__all__ = ["DetectionFile", "read_detection_file"]

_FORMS = (
    "BOP Challenge: a list of {scene_id, image_id, category_id, score, bbox}; GDRNPP and "
    'ZebraPose: {"SCENE/IMAGE": [{obj_id, bbox_est, score}]}; COCO: {images, annotations}'
)


@dataclass(frozen=True)
class DetectionFile:
    """The entries of a file of detections.

    Attributes
    ----------
    entries
        As in the BOP Challenge: ``{scene_id, image_id, category_id, score, bbox}``.
    places
        Where each of them is in the file, for messages.
    is_bop
        Whether the file itself is of that form.
    """

    entries: list[Any]
    places: list[str]
    is_bop: bool


def read_detection_file(path: str | PathLike[str]) -> DetectionFile:
    """Read a file of detections, whichever of the known forms it has.

    Raises
    ------
    FormatError
        If it is none of them, or is not JSON; entries are not checked.
    """
    content = read_json(path, object)
    if isinstance(content, list):
        return DetectionFile(content, [f"entry {i}" for i in range(len(content))], True)
    if isinstance(content, dict) and "annotations" in content:
        return _of_coco(content, path)
    if isinstance(content, dict) and all("/" in key for key in content) and content:
        return _by_image(content, path)
    found = f"an object with {', '.join(content) or 'nothing'}" if isinstance(content, dict) else ""
    raise FormatError(
        path,
        f"should hold a list at its top level, or be of another form that is read. {_FORMS}"
        + (f". It is {found[:100]}" if found else ""),
    )


def _by_image(content: Mapping[str, Any], path: str | PathLike[str]) -> DetectionFile:
    """Return the entries of GDRNPP's and ZebraPose's form: boxes by ``"SCENE/IMAGE"``."""
    entries: list[Any] = []
    places = []
    for key, boxes in content.items():
        parts = key.split("/")
        if len(parts) != 2:
            raise FormatError(path, "should be SCENE/IMAGE", where=repr(key))
        scene, image = (identifier(part, path, repr(key)) for part in parts)
        if not isinstance(boxes, list):
            raise FormatError(path, "should be a list of boxes", where=repr(key))
        for i, box in enumerate(boxes):
            where = f"{key}, box {i}"
            places.append(where)
            if not isinstance(box, dict):
                entries.append(box)
                continue
            entries.append({"scene_id": scene, "image_id": image, **_renamed(box, path, where)})
    return DetectionFile(entries, places, False)


def _renamed(box: Mapping[str, Any], path: str | PathLike[str], where: str) -> dict[str, Any]:
    """Return object, box and score of an entry by the names of the BOP Challenge."""
    return {
        "category_id": require(box, "obj_id", path, where),
        "bbox": require(box, "bbox_est", path, where),
        "score": require(box, "score", path, where),
        "time": box.get("time", -1.0),
    }


def _of_coco(content: Mapping[str, Any], path: str | PathLike[str]) -> DetectionFile:
    """Return the entries of a COCO file: annotations of images whose paths name the scenes.

    Annotations without a score are true ones; their score becomes 1.
    """
    annotations = content["annotations"]
    if not isinstance(annotations, list):
        raise FormatError(path, "should be a list", where="annotations")
    images = _coco_images(content, path)
    entries: list[Any] = []
    for i, entry in enumerate(annotations):
        where = f"annotation {i}"
        if isinstance(entry, dict):
            number = identifier(require(entry, "image_id", path, where), path, where)
            if number not in images:
                raise FormatError(path, f"image_id {number} is not among its images", where=where)
            scene, image = images[number]
            entry = {"score": 1.0, **entry, "scene_id": scene, "image_id": image}
        entries.append(entry)
    return DetectionFile(entries, [f"annotation {i}" for i in range(len(entries))], False)


def _coco_images(
    content: Mapping[str, Any], path: str | PathLike[str]
) -> dict[int, tuple[int, int]]:
    """Return scene and image of each of a COCO file's images.

    The scene is in the path of the image, ``000048/rgb/000001.png``, or it is the folder of the
    file, as for ``scene_gt_coco.json``.
    """
    listed = content.get("images")
    if not isinstance(listed, list):
        raise FormatError(path, "should be a list", where="images")
    own_folder = Path(path).resolve().parent.name
    out: dict[int, tuple[int, int]] = {}
    for i, entry in enumerate(listed):
        where = f"image {i}"
        number = identifier(require(entry, "id", path, where), path, where)
        name = PurePath(str(require(entry, "file_name", path, where)))
        scenes = [part for part in name.parts[:-1] if part.isdecimal()] or [own_folder]
        if not (scenes[-1].isdecimal() and name.stem.isdecimal()):
            raise FormatError(
                path,
                f"file_name is {str(name)!r}, which does not say scene and image, as in "
                "000048/rgb/000001.png",
                where=where,
            )
        scene, image = (identifier(part, path, where) for part in (scenes[-1], name.stem))
        out[number] = scene, image
    return out
