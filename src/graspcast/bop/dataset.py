"""BOP datasets: the files of a directory, put together.

Layout: https://github.com/thodan/bop_toolkit/blob/master/docs/bop_datasets_format.md
"""

from __future__ import annotations

from functools import cached_property
from os import PathLike
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from graspcast.bop.cameras import (
    Camera,
    camera_file,
    image_size,
    other_size_problem,
    read_camera,
    scene_camera,
)
from graspcast.bop.ground_truth import GroundTruth, read_ground_truth
from graspcast.bop.images import find_images, read_image, read_image_size
from graspcast.bop.models import Models
from graspcast.bop.scenes import Scenes, find_split
from graspcast.bop.targets import Target, read_targets
from graspcast.bop.true_pose_checks import check_outlines
from graspcast.errors import FormatError, GraspcastError, InputError
from graspcast.io.arguments import NAME, PATH, checked
from graspcast.io.json import by_identifier, read_json

__all__ = ["BopDataset", "Camera", "GroundTruth", "Target", "read_ground_truth", "read_targets"]

_MODELS = ("models_eval", "models", "models_cad", "models_reconst")


class BopDataset:
    """A BOP dataset's directory; files are read when they are first needed.

    Parameters
    ----------
    root
        The directory (``lmo``, ``ycbv``, …) with ``camera.json``, ``models`` and splits.
    ground_truth
        The directory of the scene folders, if it is not a split of ``root``.
    split
        The split whose scene folders are read: ``val``, ``test_primesense``; ``test`` by default,
        or the only one that begins so.
    name
        The dataset's name; the directory's by default.
    sensor
        The camera whose annotations and images are read, where the names of files end in cameras'
        (``scene_gt_cam1.json``); the only one by default.

    Raises
    ------
    InputError
        If ``root`` is not a directory.
    """

    @checked(root=PATH, ground_truth=PATH, split=NAME, name=NAME, sensor=NAME)
    def __init__(
        self,
        root: str | PathLike[str],
        *,
        ground_truth: str | PathLike[str] | None = None,
        split: str | None = None,
        name: str | None = None,
        sensor: str | None = None,
    ):
        self.root = Path(root)
        if not self.root.is_dir():
            raise InputError(
                f"{root}: no such directory; a BOP dataset's directory is needed",
                parameters=("bop",),
            )
        self.name = name or self.root.resolve().name
        self.sensor = sensor
        self.scenes = Path(ground_truth) if ground_truth else find_split(self.root, split)

    def __repr__(self) -> str:
        return f"BopDataset({self.name}, {self.scenes})"

    @cached_property
    def models(self) -> Models:
        """The models in ``models_eval``, ``models``, ``models_cad`` or ``models_reconst``.

        The first of these that the dataset has.
        """
        if (folder := self._models_folder) is not None:
            return Models(folder)
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
    def _models_folder(self) -> Path | None:
        folders = (self.root / name for name in _MODELS)
        return next((f for f in folders if (f / "models_info.json").is_file()), None)

    @cached_property
    def scene_folders(self) -> Scenes:
        """The scene folders of the split, and the camera whose files in them are read.

        Raises
        ------
        InputError
            If there are several cameras, and none is named, or not the one that is.
        """
        return Scenes.find(self.scenes, self.sensor)

    @cached_property
    def has_ground_truth(self) -> bool:
        """Whether the split has a ``scene_gt.json``; test images may have none."""
        return self.scene_folders.has("gt")

    @cached_property
    def has_images(self) -> bool:
        """Whether the split has a folder of images."""
        folders = self.scene_folders.image_folders
        return any(path for name in folders for path in self.scenes.glob(f"*/{name}/*"))

    @cached_property
    def ground_truth(self) -> GroundTruth:
        """All ground-truth poses of the split, compared with the models where there are some."""
        info = self.models.info if self._models_folder is not None else {}
        diameters = {i: model.diameter_m for i, model in info.items()}
        truth = read_ground_truth(self.scene_folders, diameters)
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

    @property
    def _camera_types(self) -> tuple[str, ...]:
        """Names of the camera: the sensor, and the type of the split."""
        return self.scene_folders.sensor, self.scenes.name.partition("_")[2]

    @cached_property
    def camera(self) -> Camera:
        """The dataset's common camera, from ``camera.json`` or the only ``camera_TYPE.json``."""
        return read_camera(camera_file(self.root, self._camera_types))

    @cached_property
    def scene_cameras(self) -> dict[tuple[int, int], Camera]:
        """Each image's camera by (scene_id, im_id), from the split's ``scene_camera.json``."""
        out = {}
        for scene_id, path in self.scene_folders.annotations("camera"):
            for im_id, image, entry in by_identifier(read_json(path, dict), path, "image"):
                where, size = f"image {image}", self.image_size
                try:
                    out[scene_id, im_id] = scene_camera(entry, path, where, size)
                except FormatError:
                    # Intrinsics of an image of another size.
                    own = self._size_in_file(scene_id, im_id)
                    if own in (None, size):
                        raise
                    out[scene_id, im_id] = scene_camera(entry, path, where, own)
        return out

    @cached_property
    def _has_scene_cameras(self) -> bool:
        return self.scene_folders.has("camera")

    def _own_camera(self, scene_id: int, im_id: int) -> Camera | None:
        return self.scene_cameras.get((scene_id, im_id)) if self._has_scene_cameras else None

    def camera_of(self, scene_id: int, im_id: int) -> Camera:
        """Return the camera of an image: from ``scene_camera.json``, else the dataset's."""
        own = self._own_camera(scene_id, im_id)
        return self.camera if own is None else own

    @cached_property
    def image_size(self) -> tuple[int, int] | None:
        """Width and height of images in pixels, by ``camera.json``; None if it lacks them.

        Those of an image with its own intrinsics may differ: :meth:`size_of`.
        """
        return image_size(self.root, self._camera_types)

    def size_of(self, scene_id: int, im_id: int) -> tuple[int, int] | None:
        """Return an image's width and height in pixels, None if they are unknown.

        They are the file's, where ``scene_camera.json`` has intrinsics for it, else the dataset's.
        """
        if self.image_size is None or self._own_camera(scene_id, im_id) is not None:
            return self._size_in_file(scene_id, im_id) or self.image_size
        return self.image_size

    def _size_in_file(self, scene_id: int, im_id: int) -> tuple[int, int] | None:
        path = self.images.get((scene_id, im_id)) if self.has_images else None
        try:
            return None if path is None else read_image_size(path)
        except FormatError:
            return None

    @cached_property
    def images(self) -> dict[tuple[int, int], Path]:
        """Each image's RGB file by (scene_id, im_id), of the split.

        Raises
        ------
        InputError
            If there are none.
        """
        return find_images(self.scenes, self.scene_folders.image_folders)

    def image(self, scene_id: int, im_id: int) -> UInt8[ndarray, "h w 3"]:
        """Read an RGB image, and check that intrinsics are known for its size.

        It is the size in ``camera.json``, unless the image has other intrinsics of its own.

        Raises
        ------
        InputError
            If there is no such image.
        FormatError
            If it is not RGB, of a size for which there are no intrinsics, or broken.
        """
        if (scene_id, im_id) not in self.images:
            raise InputError(f"no image {scene_id}/{im_id} in {self.scenes}")
        path = self.images[scene_id, im_id]
        image = read_image(path, gray=path.parent.name not in ("rgb", f"rgb_{self.sensor}"))
        size, usual = (image.shape[1], image.shape[0]), self.image_size
        own = self._own_camera(scene_id, im_id)
        if usual not in (None, size) and (
            problem := other_size_problem(self.root, None if own is None else own.K, size)
        ):
            raise FormatError(
                path,
                f"has {size[0]} x {size[1]} pixels, but camera.json says {usual[0]} x {usual[1]}, "
                f"the size for which the intrinsics hold, {problem}",
            )
        return image
