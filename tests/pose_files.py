"""Poses in the forms of several estimators, written for tests of what reads them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from graspcast.bop.results import Results


def sam6d_entries(results: Results) -> list[dict[str, Any]]:
    """As ``detection_pem.json``: BOP detections with R and t (mm)."""
    return [
        {
            "scene_id": int(results.scene_id[i]),
            "image_id": int(results.im_id[i]),
            "category_id": int(results.obj_id[i]),
            "bbox": [10, 20, 30, 40],
            "score": float(results.score[i]),
            "time": 0.25,
            "segmentation": {"counts": [0, 3], "size": [48, 64]},
            "R": results.cam_T_obj[i, :3, :3].tolist(),
            "t": (1000 * results.cam_T_obj[i, :3, 3]).tolist(),
        }
        for i in range(len(results))
    ]


def megapose_entries(results: Results, label: str = "ycbv-obj_{:06d}") -> list[dict[str, Any]]:
    """As ``object_data.json``: quaternions xyzw and positions in metres, of one image."""
    return [
        {
            "label": label.format(int(results.obj_id[i])),
            "TWO": [
                Rotation.from_matrix(results.cam_T_obj[i, :3, :3]).as_quat().tolist(),
                results.cam_T_obj[i, :3, 3].tolist(),
            ],
        }
        for i in range(len(results))
    ]


def write_matrices(folder: Path, results: Results) -> Path:
    """As FoundationPose's ``ob_in_cam``: one text file an image, in metres."""
    folder.mkdir(parents=True)
    for i in range(len(results)):
        np.savetxt(folder / f"{results.im_id[i]:06d}.txt", results.cam_T_obj[i])
    return folder


def write_json(path: Path, content: Any) -> Path:
    path.write_text(json.dumps(content))
    return path
