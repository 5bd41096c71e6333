"""Camera poses against objects that stand still."""

from __future__ import annotations

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
