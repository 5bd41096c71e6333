"""A small BOP dataset with images, for tests of what looks at them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results
from poses import nudged, random_poses, results_of, write_models

SIZE = (96, 64)
FOCAL = 120.0
IMAGES = ((1, 3), (1, 8), (2, 3))
"""(scene, image); not counted from 0, as in real datasets."""


def write_dataset(root: Path, ending: str = ".png") -> BopDataset:
    """Objects 1 and 5 in each of three images, with all that BOP states about them."""
    write_models(root / "models", obj_1={}, obj_5={})
    camera = {"fx": FOCAL, "fy": FOCAL, "cx": SIZE[0] / 2, "cy": SIZE[1] / 2}
    camera |= {"width": SIZE[0], "height": SIZE[1], "depth_scale": 1.0}
    (root / "camera.json").write_text(json.dumps(camera))
    truth = random_poses(2 * len(IMAGES), depth_m=0.8)
    for scene in {scene for scene, _ in IMAGES}:
        poses, info, cameras = {}, {}, {}
        for number, (_, im_id) in enumerate(key for key in IMAGES if key[0] == scene):
            rows = [2 * number, 2 * number + 1]
            poses[im_id] = [_pose(truth[i], obj_id) for i, obj_id in zip(rows, (1, 5), strict=True)]
            info[im_id] = [_seen(truth[i]) for i in rows]
            cameras[im_id] = {"cam_K": [FOCAL, 0, 48, 0, FOCAL, 32, 0, 0, 1], "depth_scale": 1.0}
            write_image(root / "test" / f"{scene:06d}" / "rgb" / f"{im_id:06d}{ending}", seed=im_id)
        folder = root / "test" / f"{scene:06d}"
        (folder / "scene_gt.json").write_text(json.dumps(poses))
        (folder / "scene_gt_info.json").write_text(json.dumps(info))
        (folder / "scene_camera.json").write_text(json.dumps(cameras))
    return BopDataset(root)


def estimates_of(dataset: BopDataset, seed: int = 0) -> Results:
    """An estimate of each instance, with small random errors, in the order of the ground truth."""
    truth = dataset.ground_truth
    results = results_of(nudged(truth.cam_T_obj, seed))
    return replace(results, scene_id=truth.scene_id, im_id=truth.im_id, obj_id=truth.obj_id)


def write_image(
    path: Path, *, seed: int = 0, size: tuple[int, int] = SIZE, mode: str = "RGB"
) -> Path:
    """Noise of another colour for each seed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    noise = np.random.default_rng(seed).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
    Image.fromarray(noise).convert(mode).save(path)
    return path


def _pose(cam_T_obj: np.ndarray, obj_id: int) -> dict[str, Any]:
    rotation = cam_T_obj[:3, :3].ravel().tolist()
    return {
        "obj_id": obj_id,
        "cam_R_m2c": rotation,
        "cam_t_m2c": (1000 * cam_T_obj[:3, 3]).tolist(),
    }


def _seen(cam_T_obj: np.ndarray) -> dict[str, Any]:
    x, y, z = cam_T_obj[:3, 3]
    side = FOCAL * 0.12 / z
    left, top = FOCAL * x / z + 48 - side / 2, FOCAL * y / z + 32 - side / 2
    box = [int(left), int(top), int(side), int(side)]
    return {"bbox_obj": box, "bbox_visib": box, "visib_fract": 0.9, "px_count_all": 300}


def write_boxes(path: Path, *entries: dict[str, Any]) -> Path:
    """A detections file of these entries."""
    path.write_text(json.dumps(list(entries)))
    return path


def box(scene_id: int = 1, image_id: int = 3, **changes: Any) -> dict[str, Any]:
    """An entry of a detections file, as detectors of the BOP Challenge write it."""
    return {
        "scene_id": scene_id,
        "image_id": image_id,
        "category_id": 1,
        "score": 0.9999793767929077,
        "bbox": [40.11715698242188, 20.7527160644531, 18.1627197265625, 17.91015625],
        "segmentation": {"counts": [6144], "size": [64, 96]},
        "time": 0.05169248580932617,
    } | changes
