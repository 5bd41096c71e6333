"""Camera poses against objects that stand still."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from graspcast.diagnosis.motions import motion_findings
from graspcast.diagnosis.pairs import sources_of
from graspcast.pose.transforms import invert
from graspcast.views.camera_motion import CameraMotion
from sick_files import IMAGES, case_of, healthy


@pytest.mark.parametrize(
    ("change", "expected"),
    [(lambda p: p, []), (invert, ["camera-poses-inverted"])],
)
def test_the_direction_of_camera_poses(tmp_path: Path, change: object, expected: list[str]) -> None:
    files = healthy()
    at = np.array([0.05, 0.02, 0.0])
    second = files.truth[1].copy()
    second[:, :3, 3] += second[:, :3, :3] @ at
    files.truth[2] = second
    case = case_of(files.write(tmp_path))
    world_T_cam = invert(files.truth[1])  # the first object stands in the world's origin
    poses = {(1, i): change(world_T_cam[i : i + 1])[0] for i in range(IMAGES)}  # type: ignore[operator]
    case.motions = [CameraMotion(poses, "motion.csv")]
    assert [f.code for f in motion_findings(case, sources_of(case)[0])] == expected


@pytest.mark.parametrize(("inverted", "expected"), [(False, []), (True, ["camera-poses-inverted"])])
def test_camera_poses_of_the_scene_are_held_against_its_truth(
    tmp_path: Path, inverted: bool, expected: list[str]
) -> None:
    files = healthy(names=())
    second = files.truth[1].copy()
    second[:, :3, 3] += second[:, :3, :3] @ np.array([0.05, 0.02, 0.0])
    files.truth[2] = second
    paths = files.write(tmp_path)
    cam_T_world = invert(files.truth[1]) if inverted else files.truth[1]
    entries = {
        str(i): {
            "cam_K": [600.0, 0, 320, 0, 600, 240, 0, 0, 1],
            "cam_R_w2c": cam_T_world[i, :3, :3].ravel().tolist(),
            "cam_t_w2c": (1000 * cam_T_world[i, :3, 3]).tolist(),
        }
        for i in range(IMAGES)
    }
    camera = tmp_path / "toy" / "test" / "000001" / "scene_camera.json"
    camera.write_text(json.dumps(entries))
    case = case_of(paths)
    assert case.findings == []
    assert [f.code for f in motion_findings(case, sources_of(case)[0])] == expected
    case.motions = [CameraMotion({(1, 0): np.eye(4)}, "motion.csv")]
    case.scenes.clear()
    assert list(motion_findings(case, {})) == [], "there is nothing to hold them against"
