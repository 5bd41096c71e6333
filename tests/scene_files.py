"""Scene folders of a BOP dataset, written for tests of what reads them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

EYE = [1, 0, 0, 0, 1, 0, 0, 0, 1]


def entry(obj_id: int = 1, **changes: Any) -> dict[str, Any]:
    return {"cam_R_m2c": EYE, "cam_t_m2c": [0, 0, 900], "obj_id": obj_id} | changes


def write_scene(root: Path, images: Any, info: Any = None, scene: int = 1) -> Path:
    folder = root / "test" / f"{scene:06d}"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene_gt.json").write_text(json.dumps(images))
    if info is not None:
        (folder / "scene_gt_info.json").write_text(json.dumps(info))
    return folder.parent


def name_sensor(split: Path, sensor: str) -> None:
    """Add a camera's name to the annotation files and image folders of a split."""
    for scene in split.iterdir():
        for path in list(scene.iterdir()):
            path.rename(path.with_name(f"{path.stem}_{sensor}{path.suffix}"))
