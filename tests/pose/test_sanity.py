"""Which poses cannot be those of an object seen by a camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import read_results
from graspcast.pose.sanity import FARTHEST_M, NEAREST_M, is_placeholder, pose_problems
from poses import random_poses

GOOD = random_poses(1, 3)[0]
DIAMETER = np.array([0.2])


def changed(**parts: object) -> np.ndarray:
    pose = GOOD.copy()
    for name, value in parts.items():
        if name == "R":
            pose[:3, :3] = value
        elif name == "t":
            pose[:3, 3] = value
        else:
            pose[3] = value
    return pose


R, T = GOOD[:3, :3], np.array([0.1, -0.05, 0.8])


@pytest.mark.parametrize(
    ("pose", "says"),
    [
        (changed(t=T), ""),
        (changed(t=[0.1, np.nan, 1]), "not finite"),
        (changed(t=T, row=[0, 0, 0, 2]), "last row 0 0 0 2, not 0 0 0 1"),
        (changed(t=T).T, "it looks transposed"),
        (np.eye(4), "placeholder"),
        (changed(t=[0, 0, 0]), "placeholder"),
        (changed(R=-R, t=T), "mirrored"),
        (changed(R=R @ np.diag([1, 1, -1]), t=T), "mirrored"),
        (changed(R=1.1 * R, t=T), "scaled by 1.1"),
        (changed(R=R + [[0, 0.1, 0], [0, 0, 0], [0, 0, 0]], t=T), "no rotation matrix"),
        (changed(R=np.zeros((3, 3)), t=T), "no rotation matrix|scaled by 0"),
        (changed(t=[0.1, 0, -0.8]), "behind the camera"),
        (changed(t=1000 * T), "in millimetres (0.81 m), not in metres"),
        (changed(t=100 * T), "in centimetres (0.81 m), not in metres"),
        (changed(t=T / 1000), "in metres (0.81 m), not in millimetres"),
        (
            changed(t=[0, 0, 0.05]),
            "that is 50 mm, but an object 200 mm across should be 100 mm to 20 m away",
        ),
    ],
)
def test_each_problem_is_named(pose: np.ndarray, says: str) -> None:
    (said,) = pose_problems(pose[None], DIAMETER)
    if says == "":
        assert said == ""
    else:
        assert any(part in said for part in says.split("|")), said


@given(st.integers(0, 10**6), st.floats(0.5, 30), st.floats(0.02, 2))
def test_plausible_poses_are_sane_in_any_direction(
    seed: int, ratio: float, diameter: float
) -> None:
    rng = np.random.default_rng(seed)
    pose = random_poses(1, seed)[0]
    ray = np.append(rng.uniform(-0.5, 0.5, 2), 1.0)
    pose[:3, 3] = ray / np.linalg.norm(ray) * ratio * diameter * 1.001
    assert pose_problems(pose[None], np.array([diameter])) == [""]
    # Without the object's size, only what no gripper reaches is refused.
    distance = np.linalg.norm(pose[:3, 3])
    (said,) = pose_problems(pose[None])
    assert (said == "") == (NEAREST_M <= distance <= FARTHEST_M), said


def test_placeholders_whatever_the_rotation() -> None:
    poses = random_poses(5, 1)
    poses[[1, 3], :3, 3] = 0
    assert is_placeholder(poses).tolist() == [False, True, False, True, False]
    assert not is_placeholder(poses[[0, 2, 4]].swapaxes(1, 2)).any()


def test_nearly_all_published_estimates_are_sane(data_dir: Path) -> None:
    odd = 0
    for dataset in ("lmo", "ycbv"):
        info = BopDataset(data_dir / "bop" / dataset).models.info
        for estimator in ("epos", "gdrnpp", "zebrapose"):
            path = data_dir / "published" / dataset / f"{estimator}_{dataset}-test.csv"
            table = read_results(path)
            known = np.isin(table.obj_id, list(info))
            diameters = np.array([info[i].diameter_m for i in table.obj_id[known].tolist()])
            odd += sum(map(bool, pose_problems(table.cam_T_obj[known], diameters)))
    assert odd == 1  # a ZebraPose estimate 17 m away
