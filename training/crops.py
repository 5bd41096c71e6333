"""Training samples: crops of rendered images with object coordinates, in files on disk.

A file depends only on the models, the seed and its number, and is written atomically, so rendering
can be resumed, and training can start while it runs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from graspcast.bop.meshes import read_coloured_mesh
from graspcast.bop.models import Models
from graspcast.io.files import atomic_write
from graspcast.perception.crops import Crop, resample
from graspcast.pose.transforms import invert, transform_points
from graspcast.rendering.synthetic.camera import INTRINSICS, random_view
from graspcast.rendering.synthetic.renderer import Frame, Renderer
from graspcast.rendering.synthetic.tabletop import ColouredMesh, Tabletop

PIXELS, CELLS = 96, 48
"""Side of a stored crop: pixels of the image, cells of the object coordinates."""
STORED_MARGIN = 1.5
"""A stored crop's side, as a multiple of the box's longer side: leaves room for jitter."""
LAYOUTS, VIEWS = 20, 16
"""Arrangements of objects per file, and views of each."""
LEAST_VISIBLE = 0.15


@dataclass(frozen=True)
class Objects:
    """The models that a network is trained for."""

    ids: tuple[int, ...]
    meshes: dict[int, ColouredMesh]
    models: Models

    @classmethod
    def read(cls, directory: Path) -> Objects:
        models = Models(directory)
        meshes = {}
        for obj_id in sorted(models.info):
            mesh, colours = read_coloured_mesh(directory / f"obj_{obj_id:06d}.ply")
            meshes[obj_id] = ColouredMesh(mesh.vertices, mesh.faces, colours)
        return cls(tuple(meshes), meshes, models)


def render(directory: Path, objects: Objects, *, seed: int, files: int, first: int = 0) -> None:
    """Write the missing ones of the files ``first`` to ``files`` - 1 into a directory."""
    directory.mkdir(parents=True, exist_ok=True)
    wanted = [
        (k, path) for k in range(first, files) if not (path := directory / f"{k:05d}.npz").exists()
    ]
    if not wanted:
        return
    hulls = {k: m.vertices[ConvexHull(m.vertices).vertices] for k, m in objects.meshes.items()}
    tabletop = Tabletop(objects.meshes, width=1280, height=960)
    with Renderer(tabletop, INTRINSICS) as renderer:
        for k, path in wanted:
            samples = []
            for layout in range(LAYOUTS):
                rng = np.random.default_rng([seed, k, layout])
                tabletop.lay_out(rng)
                renderer.new_layout()
                centre = tabletop.poses()[tabletop.present, :3, 3].mean(axis=0)
                for _ in range(VIEWS):
                    frame = renderer.frame(random_view(rng, centre))
                    samples.extend(_samples(frame, objects, hulls))
            columns = {name: np.stack([s[name] for s in samples]) for name in samples[0]}
            with atomic_write(path) as temporary, temporary.open("wb") as stream:
                np.savez(stream, **columns)
            print(f"{path}: {len(samples)} crops", flush=True)


def _samples(frame: Frame, objects: Objects, hulls: dict) -> Iterator[dict]:
    height, width = frame.label.shape
    for k, obj_id in enumerate(objects.ids):
        shown = int((frame.label == k).sum())
        if shown < 60:
            continue
        pose = frame.cam_T_obj[k]
        pixels = transform_points(pose, hulls[obj_id]) @ INTRINSICS.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        if shown < LEAST_VISIBLE * ConvexHull(pixels).volume:
            continue
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        crop = Crop(*((low + high) / 2), STORED_MARGIN * float((high - low).max()))
        # The pixel nearest to each cell's centre, where coordinates are exact.
        axis = (np.arange(CELLS) + 0.5) / CELLS - 0.5
        u, v = np.meshgrid(crop.u + crop.side * axis, crop.v + crop.side * axis)
        x, y = np.rint(u).astype(int), np.rint(v).astype(int)
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
        mask = inside & (frame.label[y, x] == k)
        rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(INTRINSICS).T
        points = transform_points(invert(pose), (rays * frame.depth_m[y, x][..., None])[mask])
        info = objects.models[obj_id]
        coordinates = np.zeros((CELLS, CELLS, 3), dtype=np.uint8)
        coordinates[mask] = np.clip(np.rint(255 * (points - info.lower) / info.size), 0, 255)
        yield {
            "image": resample(frame.rgb, crop, PIXELS),
            "coordinates": coordinates,
            "mask": mask,
            "object": np.int64(k),
            "cam_T_obj": pose,
            "crop": np.array([crop.u, crop.v, crop.side]),
            "visible": np.float32(shown / ConvexHull(pixels).volume),
        }
