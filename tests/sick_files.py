"""A small dataset with two estimators, whole or damaged, for the tests of the diagnosis."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy import ndarray

from graspcast.bop.meshes import Mesh, write_mesh
from graspcast.bop.models_writing import info_entry
from graspcast.bop.results import Results, write_results
from graspcast.diagnosis.case import Case, cases_of, read_case
from graspcast.diagnosis.discovery import discover
from graspcast.diagnosis.projection import rays_of
from graspcast.pose.transforms import rotation_from_vector, transform

K = np.array([[600.0, 0, 320], [0, 600.0, 240], [0, 0, 1]])
IMAGES = 24


def solid(scale: float = 1.0) -> Mesh:
    """A stair of three steps, 90 mm long, which has no symmetry."""
    boxes = [
        trimesh.creation.box((0.09, 0.06, 0.02)),
        trimesh.creation.box((0.05, 0.03, 0.03)),
        trimesh.creation.box((0.02, 0.02, 0.03)),
    ]
    for box, at in zip(boxes, ((0, 0, 0), (-0.02, 0.015, 0.02), (-0.03, 0.02, 0.05)), strict=True):
        box.apply_translation(at)
    made = trimesh.util.concatenate([b.subdivide().subdivide() for b in boxes])
    return Mesh(np.array(made.vertices) * scale, np.array(made.faces))


@dataclass
class SickFiles:
    """Files in memory, to be damaged and written."""

    truth: dict[int, ndarray]
    meshes: dict[int, Mesh]
    estimates: dict[str, dict[int, ndarray]]
    K: ndarray = field(default_factory=K.copy)
    scores: dict[str, float] = field(default_factory=dict)
    boxes: Any = None
    info: dict[str, Any] = field(default_factory=dict)

    def write(self, root: Path, *, with_truth: bool = True) -> list[tuple[str | None, Path]]:
        home = root / "toy"
        (home / "models").mkdir(parents=True)
        for i, mesh in self.meshes.items():
            write_mesh(home / "models" / f"obj_{i:06d}.ply", mesh)
        _dump(home / "models" / "models_info.json", self.info)
        K = self.K
        sizes = {"width": 640, "height": 480}
        _dump(
            home / "camera.json",
            {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2], **sizes},
        )
        folder = home / "test" / "000001"
        folder.mkdir(parents=True)
        if with_truth:
            truth = {
                str(im): [
                    {
                        "obj_id": i,
                        "cam_R_m2c": self.truth[i][im, :3, :3].ravel().tolist(),
                        "cam_t_m2c": (1000 * self.truth[i][im, :3, 3]).tolist(),
                    }
                    for i in self.truth
                ]
                for im in range(IMAGES)
            }
            _dump(folder / "scene_gt.json", truth)
            if self.boxes is not None:
                seen = {
                    str(im): [
                        {"visib_fract": 1.0, "bbox_obj": self.boxes[i][im].tolist()}
                        for i in self.truth
                    ]
                    for im in range(IMAGES)
                }
                _dump(folder / "scene_gt_info.json", seen)
        paths: list[tuple[str | None, Path]] = [(None, home)]
        for name, poses in self.estimates.items():
            path = root / f"{name}_toy-test.csv"
            write_results(path, self.results(name, poses))
            paths.append((name, path))
        return paths

    def results(self, name: str, poses: dict[int, ndarray]) -> Results:
        n = IMAGES * len(poses)
        images = np.tile(np.arange(IMAGES), len(poses))
        score = np.linspace(0.1, 0.9, n)
        return Results(
            scene_id=np.ones(n, dtype=np.int64),
            im_id=images,
            obj_id=np.repeat(list(poses), IMAGES),
            score=np.full(n, self.scores[name]) if name in self.scores else score,
            cam_T_obj=np.concatenate(list(poses.values())),
            time_s=np.full(n, -1.0),
            line=np.zeros(n, dtype=np.int64),
        )


def healthy(seed: int = 0, *, names: tuple[str, ...] = ("a", "b")) -> SickFiles:
    """Return files of which nothing is wrong: two objects in 24 images, errors of 2 mm and 2°."""
    rng = np.random.default_rng(seed)
    truth = {i: _views(rng) for i in (1, 2)}
    meshes = {1: solid(), 2: solid(1.3)}
    estimates = {
        name: {i: poses @ _errors(rng, len(poses)) for i, poses in truth.items()} for name in names
    }
    files = SickFiles(truth, meshes, estimates)
    files.info = {str(i): info_entry(mesh.vertices) for i, mesh in meshes.items()}
    files.boxes = {i: boxes_of(meshes[i], poses) for i, poses in truth.items()}
    return files


def boxes_of(mesh: Mesh, poses: ndarray) -> ndarray:
    """Return the boxes of a projected mesh: x, y, width, height, (n, 4)."""
    left, top, right, bottom = rays_of(mesh.vertices, poses).T * 600
    return np.stack([left + 320, top + 240, right - left, bottom - top], axis=1)


def case_of(paths: list[tuple[str | None, Path]]) -> Case:
    """Read written files as the diagnosis does."""
    (group,) = cases_of(discover(paths)[0])
    return read_case(group)


def _views(rng: np.random.Generator) -> ndarray:
    R = rotation_from_vector(rng.normal(size=(IMAGES, 3)) * 1.2)
    t = np.stack([*rng.uniform(-0.12, 0.12, (2, IMAGES)), rng.uniform(0.7, 1.0, IMAGES)], axis=1)
    return transform(R, t)


def _errors(rng: np.random.Generator, n: int) -> ndarray:
    return transform(
        rotation_from_vector(rng.normal(0, 0.02, (n, 3))), rng.normal(0, 0.002, (n, 3))
    )


def _dump(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content))
