"""Ground truth of a BOP dataset: ``scene_gt.json`` and ``scene_gt_info.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.bop.rotations import checked_rotations
from graspcast.bop.scenes import Scenes
from graspcast.bop.summary import summary
from graspcast.bop.true_pose_checks import check_true_poses
from graspcast.bop.units import metres
from graspcast.errors import FormatError
from graspcast.io.json import by_identifier, identifier, numbers, read_json, require
from graspcast.pose.transforms import transform

__all__ = ["GroundTruth", "read_ground_truth"]


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """Ground-truth poses of the annotated instances, image by image.

    Attributes
    ----------
    scene_id, im_id, obj_id
        BOP ids, (n,).
    gt_id
        Row of the instance in its image's list in ``scene_gt.json``, from 0, (n,).
    cam_T_obj
        Poses in metres, (n, 4, 4).
    visib_fract
        Visible fraction of the silhouette, NaN if unknown, (n,).
    source
        Where they came from, for messages.
    box_xywh
        Amodal bounding boxes: left, top, width, height of the whole silhouette in pixels,
        occluded parts included, NaN if unknown, (n, 4).
    """

    scene_id: Int[ndarray, " n"]
    im_id: Int[ndarray, " n"]
    obj_id: Int[ndarray, " n"]
    gt_id: Int[ndarray, " n"]
    cam_T_obj: Float[ndarray, "n 4 4"]
    visib_fract: Float[ndarray, " n"]
    source: str = "ground truth"
    box_xywh: Float[ndarray, "n 4"] | None = None

    def __len__(self) -> int:
        return len(self.obj_id)

    def __repr__(self) -> str:
        return f"GroundTruth({summary(self, 'pose')})"


def read_ground_truth(
    directory: str | PathLike[str] | Scenes, diameters_m: Mapping[int, float] | None = None
) -> GroundTruth:
    """Read ``scene_gt.json`` (and ``scene_gt_info.json`` where it exists) of all scene folders.

    Matrices within 0.02 of a rotation (as in the official LM-O files) are projected to it.

    Parameters
    ----------
    directory
        The directory of the scene folders, or, where there are several cameras, those of one.
    diameters_m
        Object's number to its diameter, metres, with which distances are compared.

    Raises
    ------
    InputError
        If there are no scene folders.
    FormatError
        Naming file, image and key; also if the distances are not plausible in millimetres, or
        objects are seen behind the camera.
    """
    scenes = directory if isinstance(directory, Scenes) else Scenes.find(Path(directory))
    keys: list[tuple[int, int, int, int]] = []
    rotations: list[ndarray] = []
    translations: list[ndarray] = []
    visible: list[float] = []
    boxes: list[ndarray] = []
    for scene_id, path in scenes.annotations("gt"):
        images = read_json(path, dict)
        info_path = path.with_name(scenes.file("gt_info"))
        info = read_json(info_path, dict) if info_path.exists() else {}
        scene_start = len(rotations)
        for im_id, image, instances in by_identifier(images, path, "image"):
            where = f"image {image}"
            if not isinstance(instances, list):
                raise FormatError(path, "should be a list of instances", where=where)
            shares, outlines = _seen(info.get(image), len(instances), info_path, where)
            for i, entry in enumerate(instances):
                at = f"{where}, instance {i}"
                obj_id = identifier(require(entry, "obj_id", path, at), path, at)
                keys.append((scene_id, im_id, obj_id, i))
                rotations.append(numbers(require(entry, "cam_R_m2c", path, at), (3, 3), path, at))
                translations.append(numbers(require(entry, "cam_t_m2c", path, at), (3,), path, at))
            visible.extend(shares)
            boxes.extend(outlines)
        check_true_poses(
            path,
            np.array(keys[scene_start:], dtype=np.int64).reshape(-1, 4)[:, 1:3],
            np.array(rotations[scene_start:]).reshape(-1, 3, 3),
            metres(np.array(translations[scene_start:]).reshape(-1, 3)),
            np.array(visible[scene_start:]),
            diameters_m,
        )
    table = np.array(keys, dtype=np.int64).reshape(-1, 4)
    rotation, _ = checked_rotations(np.array(rotations).reshape(-1, 3, 3))
    return GroundTruth(
        scene_id=table[:, 0],
        im_id=table[:, 1],
        obj_id=table[:, 2],
        gt_id=table[:, 3],
        cam_T_obj=transform(rotation, metres(np.array(translations).reshape(-1, 3))),
        visib_fract=np.array(visible, dtype=np.float64),
        source=str(scenes.directory),
        box_xywh=np.array(boxes, dtype=np.float64).reshape(-1, 4),
    )


def _seen(
    entries: Any, count: int, path: Path, where: str
) -> tuple[list[float], list[Float[ndarray, "4"]]]:
    """Return visible fractions and boxes of an image's instances, from ``scene_gt_info.json``."""
    unknown = np.full(4, np.nan)
    if entries is None:
        return [float("nan")] * count, [unknown] * count
    if not isinstance(entries, list) or len(entries) != count:
        raise FormatError(path, f"should list {count} instances, as scene_gt.json", where=where)
    shares, boxes = [], []
    for entry in entries:
        if not isinstance(entry, dict):
            raise FormatError(path, "should be an object for each instance", where=where)
        share = entry.get("visib_fract", np.nan)
        known = share is not None and not (isinstance(share, float) and np.isnan(share))
        at = f"{where}, visib_fract"
        shares.append(float(numbers(share, (), path, at)) if known else float("nan"))
        box = entry.get("bbox_obj")
        at = f"{where}, bbox_obj"
        boxes.append(unknown if box is None else numbers(box, (4,), path, at))
    return shares, boxes
