"""Camera poses from files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from graspcast.errors import FormatError, InputError
from graspcast.pose.transforms import invert, quaternion
from graspcast.views.camera_tables import read_camera_motion
from static_scenes import orbit

CAMERAS = orbit(3)
SEVEN = ("qw", "qx", "qy", "qz", "tx_{}", "ty_{}", "tz_{}")


def matrix_table(path: Path, column: str = "world_T_cam_m", poses: np.ndarray = CAMERAS) -> Path:
    rows = [f"1,{i},{' '.join(map(repr, pose.ravel().tolist()))}" for i, pose in enumerate(poses)]
    path.write_text("\n".join([f"scene_id,im_id,{column}", *rows]) + "\n")
    return path


def scaled(poses: np.ndarray, by: float) -> np.ndarray:
    out = poses.copy()
    out[:, :3, 3] *= by
    return out


@pytest.mark.parametrize(
    ("column", "poses"),
    [
        ("world_T_cam_m", CAMERAS),
        ("world_T_cam_mm", scaled(CAMERAS, 1e3)),
        ("cam_T_world_m", invert(CAMERAS)),
        ("cam_T_world_cm", scaled(invert(CAMERAS), 1e2)),
    ],
)
def test_matrices_of_every_direction_and_unit(
    tmp_path: Path, column: str, poses: np.ndarray
) -> None:
    motion = read_camera_motion(matrix_table(tmp_path / "c.csv", column, poses))
    for i, camera in enumerate(CAMERAS):
        np.testing.assert_allclose(motion.world_T_cam[1, i], camera, atol=1e-12)


def test_quaternions(tmp_path: Path) -> None:
    names = [f"cam_T_world_{part.format('mm')}" for part in SEVEN]
    poses = invert(CAMERAS)
    lines = [",".join(["im_id", *names, "scene_id", "note"])]
    for i, pose in enumerate(poses):
        values = [*quaternion(pose[:3, :3]).tolist(), *(pose[:3, 3] * 1e3).tolist()]
        lines.append(",".join([str(i), *map(repr, values), "1", "x"]))
    path = tmp_path / "c.csv"
    path.write_text("\n".join(lines))
    motion = read_camera_motion(path)
    np.testing.assert_allclose(motion.world_T_cam[1, 2], CAMERAS[2], atol=1e-12)
    path.write_text("\n".join(lines).replace(lines[1].split(",")[1], "2.0"))
    with pytest.raises(FormatError, match="line 2: the quaternion has the length"):
        read_camera_motion(path)


@pytest.mark.parametrize(
    ("header", "says"),
    [
        ("scene_id,im_id,world_T_cam", "states no pose with its direction and unit"),
        ("scene_id,im_id,pose_m", "states no pose with its direction and unit"),
        ("scene_id,im_id," + ",".join(p.format("m") for p in SEVEN), "states no pose"),
        ("scene_id,image,world_T_cam_m", "no column im_id"),
        ("scene_id,im_id,world_T_cam_m,cam_T_world_m", "more than one pose"),
        ("scene_id,im_id,im_id,world_T_cam_m", "comes twice"),
        ("", "no column scene_id and im_id"),
    ],
)
def test_a_header_without_direction_or_unit_is_refused(
    tmp_path: Path, header: str, says: str
) -> None:
    path = tmp_path / "c.csv"
    path.write_text(header + "\n1,2,3\n")
    with pytest.raises(FormatError, match=says):
        read_camera_motion(path)


@pytest.mark.parametrize(
    ("row", "says"),
    [
        ("1,0,1 2 3", "line 2: world_T_cam_m holds 3 numbers, not 16"),
        ("1,0,1 0 0 0 0 1 0 0 0 0 1 x 0 0 0 1", "line 2: .* no number"),
        ("1,0,1 0 0 0 0 1 0 0 0 0 2 0 0 0 0 1", "line 2: .*no rotation matrix"),
        ("1,0,1 0 0 0 0 1 0 0 0 0 1 nan 0 0 0 1", "line 2: .*not finite"),
        ("1,-4,1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1", "line 2: .*whole number"),
        ("1,0", "line 2: has 2 fields, the header has 3"),
        ("", "holds no camera pose"),
    ],
)
def test_a_bad_row_is_named(tmp_path: Path, row: str, says: str) -> None:
    path = tmp_path / "c.csv"
    path.write_text(f"scene_id,im_id,world_T_cam_m\n{row}\n")
    with pytest.raises(FormatError, match=says):
        read_camera_motion(path)


def test_an_image_that_comes_twice_is_named(tmp_path: Path) -> None:
    path = matrix_table(tmp_path / "c.csv")
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines, lines[1]]))
    with pytest.raises(FormatError, match="line 5: image 1/0 has a pose in line 2 already"):
        read_camera_motion(path)


def test_scene_folders(tmp_path: Path) -> None:
    folder = tmp_path / "000004"
    folder.mkdir()
    w2c = invert(CAMERAS[1])
    entry = {
        "cam_R_w2c": w2c[:3, :3].ravel().tolist(),
        "cam_t_w2c": (w2c[:3, 3] * 1e3).tolist(),
    }
    (folder / "scene_camera.json").write_text(json.dumps({"3": entry, "5": {}}))
    motion = read_camera_motion(tmp_path)
    assert set(motion.world_T_cam) == {(4, 3)}
    np.testing.assert_allclose(motion.world_T_cam[4, 3], CAMERAS[1], atol=1e-9)
    (folder / "scene_camera.json").write_text(json.dumps({"5": {}}))
    with pytest.raises(InputError, match="no image here has a camera pose"):
        read_camera_motion(tmp_path)


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.csv"):
        read_camera_motion(tmp_path / "none.csv")
