"""Camera poses of scene_camera.json."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspcast.bop.camera_poses import read_scene_camera_poses
from graspcast.errors import FormatError, InputError

EYE = np.eye(3).ravel().tolist()


def write(root: Path, entry: Any, folder: str = "000001") -> Path:
    (root / folder).mkdir(exist_ok=True)
    (root / folder / "scene_camera.json").write_text(json.dumps({"7": entry}))
    return root


def test_w2c_in_millimetres_becomes_world_T_cam_in_metres(tmp_path: Path) -> None:
    turn = [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    write(tmp_path, {"cam_R_w2c": turn, "cam_t_w2c": [100.0, 0.0, 0.0]})
    pose = read_scene_camera_poses(tmp_path)[1, 7]
    np.testing.assert_allclose(pose[:3, 3], [0.0, 0.1, 0.0], atol=1e-15)
    np.testing.assert_allclose(pose[:3, :3] @ [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], atol=1e-15)


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ({"cam_R_w2c": EYE}, "image 7: no 'cam_t_w2c'"),
        ({"cam_t_w2c": [0, 0, 0]}, "image 7: no 'cam_R_w2c'"),
        ({"cam_R_w2c": [2, *EYE[1:]], "cam_t_w2c": [0, 0, 0]}, "cam_R_w2c: is 1 away"),
        ({"cam_R_w2c": EYE, "cam_t_w2c": [0, 0]}, "should be 3 finite numbers"),
        ([], "should be an object"),
    ],
)
def test_wrong_entries_are_named(tmp_path: Path, entry: Any, says: str) -> None:
    with pytest.raises(FormatError, match=says):
        read_scene_camera_poses(write(tmp_path, entry))


def test_no_folder_and_two_of_one_scene(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no scene folder here has a scene_camera\.json"):
        read_scene_camera_poses(tmp_path)
    for folder in ("000001", "1"):
        write(tmp_path, {"cam_R_w2c": EYE, "cam_t_w2c": [0, 0, 0]}, folder)
    with pytest.raises(FormatError, match="another folder is scene 1 too"):
        read_scene_camera_poses(tmp_path)


def test_images_without_a_pose_are_left_out(tmp_path: Path) -> None:
    entry = {"cam_K": [400, 0, 200, 0, 300, 150, 0, 0, 1]}
    assert read_scene_camera_poses(write(tmp_path, entry)) == {}
