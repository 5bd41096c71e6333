"""Training samples: crops of rendered images with object coordinates, in files on disk.

A file depends only on the models, the seed and its number, and is written atomically, so that
rendering can be resumed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray
from scipy.spatial import ConvexHull

from graspcast.errors import FormatError, InputError
from graspcast.io.files import atomic_write
from graspcast.io.progress import Count, Progress
from graspcast.perception.crops import Crop, resample
from graspcast.pose.transforms import invert, transform_points
from graspcast.rendering.synthetic.camera import INTRINSICS, random_view
from graspcast.rendering.synthetic.renderer import Frame, Renderer
from graspcast.rendering.synthetic.tabletop import Tabletop
from graspcast.training.objects import Objects

__all__ = ["STORED_CELLS", "STORED_MARGIN", "STORED_PIXELS", "Samples", "render_samples"]

STORED_PIXELS, STORED_CELLS = 96, 48
"""Side of a stored crop: pixels of the image, cells of the object coordinates."""
STORED_MARGIN = 1.5
"""A stored crop's side, as a multiple of the box's longer side: leaves room for jitter."""
LAYOUTS, VIEWS = 5, 16
"""Arrangements of objects per file, and views of each."""
_LEAST_VISIBLE, _LEAST_PIXELS = 0.15, 60
_TRAINING = 1
"""The last number of a scene's seed; it sets training apart from what ``render_dataset`` makes."""


def render_samples(
    directory: str | PathLike[str],
    objects: Objects,
    *,
    seed: int,
    images: int,
    progress: Progress | None = None,
) -> None:
    """Render the files of samples that a directory lacks.

    Parameters
    ----------
    directory
        Where files are, or will be.
    objects
        The objects.
    seed
        Random seed.
    images
        Number of images, rounded up to a multiple of 16, the views of one arrangement of objects.
    progress
        Called with the share of files done, and their number.

    Raises
    ------
    ExtraMissingError
        If PyOpenGL is not installed.
    InputError
        If OpenGL does not work, a file cannot be written, or no object is large enough in images.
    """
    directory = Path(directory)
    layouts = -(-images // VIEWS)
    files = -(-layouts // LAYOUTS)
    paths = {k: directory / f"{k:05d}.npz" for k in range(files)}
    wanted = {k: path for k, path in paths.items() if not path.exists()}
    if not wanted:
        return
    directory.mkdir(parents=True, exist_ok=True)
    hulls = {k: m.vertices[ConvexHull(m.vertices).vertices] for k, m in objects.meshes.items()}
    tabletop = Tabletop(objects.meshes, width=1280, height=960)
    with Renderer(tabletop, INTRINSICS) as renderer:
        for n, (k, path) in enumerate(wanted.items(), files - len(wanted)):
            if progress is not None:
                progress(n / files, Count(n, files, "files of training images"))
            samples: list[dict[str, Any]] = []
            for layout in range(min(LAYOUTS, layouts - k * LAYOUTS)):
                rng = np.random.default_rng([seed, k, layout, _TRAINING])
                samples.extend(_samples_of_layout(renderer, objects, hulls, rng))
            if not samples:
                raise InputError(
                    f"no object can be seen in the {VIEWS * layouts} training images, 0.5 to 1.1 m "
                    "away; are they large enough, and the models in millimetres?",
                    parameters=("models",),
                )
            columns: dict[str, Any] = {
                name: np.stack([s[name] for s in samples]) for name in samples[0]
            }
            with atomic_write(path) as temporary, temporary.open("wb") as stream:
                np.savez(stream, **columns)


def _samples_of_layout(
    renderer: Renderer, objects: Objects, hulls: Mapping[int, ndarray], rng: np.random.Generator
) -> Iterator[dict[str, Any]]:
    tabletop = renderer.tabletop
    tabletop.lay_out(rng)
    renderer.new_layout()
    centre = tabletop.poses()[tabletop.present, :3, 3].mean(axis=0)
    for _ in range(VIEWS):
        yield from _samples_of_frame(renderer.frame(random_view(rng, centre)), objects, hulls)


def _samples_of_frame(
    frame: Frame, objects: Objects, hulls: Mapping[int, ndarray]
) -> Iterator[dict[str, Any]]:
    height, width = frame.label.shape
    for k, obj_id in enumerate(objects.ids):
        shown = int((frame.label == k).sum())
        if shown < _LEAST_PIXELS:
            continue
        pose = frame.cam_T_obj[k]
        pixels = transform_points(pose, hulls[obj_id]) @ INTRINSICS.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        if shown < _LEAST_VISIBLE * ConvexHull(pixels).volume:
            continue
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        u, v = ((low + high) / 2).tolist()
        crop = Crop(u, v, STORED_MARGIN * float((high - low).max()))
        x, y = _nearest_pixels(crop)
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
        mask = inside & (frame.label[y, x] == k)
        rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(INTRINSICS).T
        points = transform_points(invert(pose), (rays * frame.depth_m[y, x][..., None])[mask])
        info = objects.models[obj_id]
        coordinates = np.zeros((STORED_CELLS, STORED_CELLS, 3), dtype=np.uint8)
        coordinates[mask] = np.clip(np.rint(255 * (points - info.lower) / info.size), 0, 255)
        yield {
            "image": resample(frame.rgb, crop, STORED_PIXELS),
            "coordinates": coordinates,
            "mask": mask,
            "object": np.int64(k),
            "cam_T_obj": pose,
            "crop": np.array([crop.u, crop.v, crop.side]),
        }


def _nearest_pixels(crop: Crop) -> tuple[ndarray, ndarray]:
    """Return column and row of the pixel nearest to each cell's centre, where depth is exact."""
    axis = (np.arange(STORED_CELLS) + 0.5) / STORED_CELLS - 0.5
    u, v = np.meshgrid(crop.u + crop.side * axis, crop.v + crop.side * axis)
    return np.rint(u).astype(int), np.rint(v).astype(int)


class Samples:
    """All stored crops of a directory, in memory.

    Parameters
    ----------
    directory
        The directory of files.

    Raises
    ------
    FormatError
        If there is no file, or one cannot be read.
    """

    def __init__(self, directory: str | PathLike[str]):
        self.columns: dict[str, list[ndarray]] = {}
        paths = sorted(Path(directory).glob("*.npz"))
        if not paths:
            raise FormatError(directory, "holds no training samples")
        for path in paths:
            try:
                with path.open("rb") as stream, np.load(stream) as stored:
                    for name in stored.files:
                        self.columns.setdefault(name, []).append(stored[name])
            except Exception as error:  # numpy and zipfile raise many types
                raise FormatError(
                    path,
                    f"is not a file of training samples ({error}); delete it to render it again",
                ) from error
        sizes = [len(a) for a in self.columns["object"]]
        self._starts = np.concatenate([[0], np.cumsum(sizes)])

    def __len__(self) -> int:
        return int(self._starts[-1])

    def take(self, rows: ndarray) -> dict[str, ndarray]:
        """Return some crops: each column of the files, for these rows."""
        file = np.searchsorted(self._starts, rows, side="right") - 1
        place = rows - self._starts[file]
        return {
            name: np.stack([parts[f][p] for f, p in zip(file, place, strict=True)])
            for name, parts in self.columns.items()
        }
