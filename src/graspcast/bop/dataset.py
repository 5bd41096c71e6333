"""BOP datasets: ground truth, cameras, targets and models of a directory.

Layout: https://github.com/thodan/bop_toolkit/blob/master/docs/bop_datasets_format.md
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy import ndarray

from graspcast.bop.images import find_images, read_image
from graspcast.bop.models import Models
from graspcast.bop.rotations import checked_rotations
from graspcast.bop.summary import summary
from graspcast.bop.true_pose_checks import check_outlines, check_true_poses
from graspcast.bop.unit_checks import camera_problem
from graspcast.bop.units import metres
from graspcast.errors import FormatError, GraspcastError, InputError
from graspcast.io.arguments import NAME, PATH, checked
from graspcast.io.json import by_identifier, identifier, numbers, read_json, require
from graspcast.pose.transforms import transform

__all__ = ["BopDataset", "Camera", "GroundTruth", "Target", "read_ground_truth", "read_targets"]

_MODELS = ("models_eval", "models")


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


@dataclass(frozen=True)
class Camera:
    """The camera of an image.

    Attributes
    ----------
    K
        Intrinsics in pixels, (3, 3).
    depth_scale_m
        Metres per unit of the depth image.
    """

    K: Float[ndarray, "3 3"]
    depth_scale_m: float


@dataclass(frozen=True)
class Target:
    """One entry of a targets file; ``obj_id`` and ``inst_count`` are None in the bop24 format."""

    scene_id: int
    im_id: int
    obj_id: int | None = None
    inst_count: int | None = None


def _scenes(directory: Path, file: str) -> Iterator[tuple[int, Path]]:
    """Yield scene id and path of ``file`` in each scene folder that has it."""
    if not directory.is_dir():
        others = [p for p in sorted(directory.parent.glob("*")) if any(p.glob(f"*/{file}"))]
        there = ", ".join(map(str, others))
        raise InputError(
            f"{directory}: no such directory; it should hold scene folders (000001 …)"
            + (f"; there is {there}; give that if it is meant" if others else ""),
            parameters=("ground_truth", "split"),
        )
    found = sorted(p for p in directory.iterdir() if p.name.isdecimal() and (p / file).exists())
    numbers_of = [int(folder.name) for folder in found]
    for folder, number in zip(found, numbers_of, strict=True):
        if numbers_of.count(number) > 1:
            raise InputError(f"{folder}: another folder here is scene {number} too; keep one")
    if not found:
        raise InputError(
            f"{directory}: no scene folder here has a {file}", parameters=("ground_truth",)
        )
    for folder in found:
        yield int(folder.name), folder / file


def read_ground_truth(
    directory: str | PathLike[str], diameters_m: Mapping[int, float] | None = None
) -> GroundTruth:
    """Read ``scene_gt.json`` (and ``scene_gt_info.json`` where it exists) of all scene folders.

    Matrices within 0.02 of a rotation (as in the official LM-O files) are projected to it.

    Parameters
    ----------
    directory
        The directory of the scene folders.
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
    directory = Path(directory)
    keys: list[tuple[int, int, int, int]] = []
    rotations: list[ndarray] = []
    translations: list[ndarray] = []
    visible: list[float] = []
    boxes: list[ndarray] = []
    for scene_id, path in _scenes(directory, "scene_gt.json"):
        images = read_json(path, dict)
        info_path = path.with_name("scene_gt_info.json")
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
        source=str(directory),
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
        share = require(entry, "visib_fract", path, where)
        shares.append(float(numbers(share, (), path, f"{where}, visib_fract")))
        box = entry.get("bbox_obj")
        at = f"{where}, bbox_obj"
        boxes.append(unknown if box is None else numbers(box, (4,), path, at))
    return shares, boxes


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


def _camera(
    entry: Any, path: Path, where: str, image_size: tuple[int, int] | None = None
) -> Camera:
    K = numbers(require(entry, "cam_K", path, where), (3, 3), path, f"{where}, cam_K")
    if problem := camera_problem(K, image_size):
        raise FormatError(path, problem, where=f"{where}, cam_K")
    scale = numbers(entry.get("depth_scale", 1.0), (), path, f"{where}, depth_scale")
    return Camera(K=K, depth_scale_m=float(metres(scale)))


class BopDataset:
    """A BOP dataset's directory; files are read when they are first needed.

    Parameters
    ----------
    root
        The directory (``lmo``, ``ycbv``, …) with ``camera.json``, ``models`` and splits.
    ground_truth
        The directory of the scene folders, if it is not a split of ``root``.
    split
        The split whose scene folders are read.
    name
        The dataset's name; the directory's by default.

    Raises
    ------
    InputError
        If ``root`` is not a directory.
    """

    @checked(root=PATH, ground_truth=PATH, split=NAME, name=NAME)
    def __init__(
        self,
        root: str | PathLike[str],
        *,
        ground_truth: str | PathLike[str] | None = None,
        split: str = "test",
        name: str | None = None,
    ):
        self.root = Path(root)
        if not self.root.is_dir():
            raise InputError(
                f"{root}: no such directory; a BOP dataset's directory is needed",
                parameters=("bop",),
            )
        self.name = name or self.root.resolve().name
        self.scenes = Path(ground_truth) if ground_truth else self.root / split

    def __repr__(self) -> str:
        return f"BopDataset({self.name}, {self.scenes})"

    @cached_property
    def models(self) -> Models:
        """The models in ``models_eval`` if the dataset has it, else in ``models``."""
        for folder in _MODELS:
            if (self.root / folder / "models_info.json").is_file():
                return Models(self.root / folder)
        others = [path.parent.name for path in sorted(self.root.glob("*/models_info.json"))]
        raise InputError(
            f"{self.root}: no models/models_info.json here; "
            + (
                f"there is {' and '.join(others)}; name it, or a link to it, models"
                if others
                else "is it a BOP dataset?"
            ),
            parameters=("bop",),
        )

    @cached_property
    def ground_truth(self) -> GroundTruth:
        """All ground-truth poses of the split, compared with the models where there are some."""
        has_models = any((self.root / f / "models_info.json").is_file() for f in _MODELS)
        info = self.models.info if has_models else {}
        diameters = {i: model.diameter_m for i, model in info.items()}
        truth = read_ground_truth(self.scenes, diameters)
        if truth.box_xywh is not None:
            check_outlines(
                truth.source,
                np.stack([truth.scene_id, truth.im_id, truth.obj_id], axis=1),
                truth.cam_T_obj[:, 2, 3],
                truth.visib_fract,
                truth.box_xywh,
                diameters_m=diameters,
                focal_px=self._focal_length,
            )
        return truth

    def _focal_length(self, scene_id: int, im_id: int) -> float:
        """Return an image's focal length in pixels, NaN if its camera is unknown or wrong."""
        try:
            return float(self.camera_of(scene_id, im_id).K[0, 0])
        except GraspcastError:
            return float("nan")

    @cached_property
    def camera(self) -> Camera:
        """The dataset's common camera, from ``camera.json``."""
        path = self.root / "camera.json"
        entry = read_json(path, dict)
        fx, fy, cx, cy = (
            float(numbers(require(entry, key, path, key), (), path, key))
            for key in ("fx", "fy", "cx", "cy")
        )
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        if problem := camera_problem(K, self.image_size):
            raise FormatError(path, problem)
        scale = numbers(entry.get("depth_scale", 1.0), (), path, "depth_scale")
        return Camera(K=K, depth_scale_m=float(metres(scale)))

    @cached_property
    def scene_cameras(self) -> dict[tuple[int, int], Camera]:
        """Each image's camera by (scene_id, im_id), from the split's ``scene_camera.json``."""
        out = {}
        for scene_id, path in _scenes(self.scenes, "scene_camera.json"):
            for im_id, image, entry in by_identifier(read_json(path, dict), path, "image"):
                out[scene_id, im_id] = _camera(entry, path, f"image {image}", self.image_size)
        return out

    def camera_of(self, scene_id: int, im_id: int) -> Camera:
        """Return the camera of an image: from ``scene_camera.json``, else the dataset's."""
        if any(self.scenes.glob("*/scene_camera.json")):
            own = self.scene_cameras.get((scene_id, im_id))
            if own is not None:
                return own
        return self.camera

    @cached_property
    def image_size(self) -> tuple[int, int] | None:
        """Width and height of every image in pixels; None if ``camera.json`` lacks them."""
        path = self.root / "camera.json"
        entry = read_json(path, dict) if path.exists() else {}
        if "width" not in entry or "height" not in entry:
            return None
        return identifier(entry["width"], path, "width"), identifier(
            entry["height"], path, "height"
        )

    @cached_property
    def images(self) -> dict[tuple[int, int], Path]:
        """Each image's RGB file by (scene_id, im_id), of the split.

        Raises
        ------
        InputError
            If there are none.
        """
        return find_images(self.scenes)

    def image(self, scene_id: int, im_id: int) -> UInt8[ndarray, "h w 3"]:
        """Read an RGB image, and check that it has the size in ``camera.json``.

        Raises
        ------
        InputError
            If there is no such image.
        FormatError
            If it is not RGB, of another size, or broken.
        """
        if (scene_id, im_id) not in self.images:
            raise InputError(f"no image {scene_id}/{im_id} in {self.scenes}")
        return read_image(self.images[scene_id, im_id], self.image_size)
