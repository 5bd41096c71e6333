"""Files of grasp poses, as other programs write them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bricks import from_top
from graspcast.errors import FormatError, InputError
from graspcast.pose.transforms import quaternion
from graspcast.simulation.grasps.pose_files import read_grasp_poses

POSES = np.array([from_top(0.02), from_top(0.01)])


def _json(path: Path, content: object) -> Path:
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def test_graspgen_s_json(tmp_path: Path) -> None:
    # https://github.com/NVlabs/GraspGen, docs/GRASP_DATASET_FORMAT.md
    content = {
        "object": {"file": "mug.obj", "scale": 0.5},
        "grasps": {"transforms": POSES.tolist(), "object_in_gripper": [False, True]},
    }
    found = read_grasp_poses(_json(tmp_path / "mug.json", content))
    assert found.form == "GraspGen" and found.names == ("grasp 1",)
    assert np.allclose(found.obj_T_hand, POSES[1:])
    assert found.notes[0] == "left out 1 failed grasp (object_in_gripper is false)"
    assert "scaled by 0.5" in found.notes[1]
    del content["grasps"]["object_in_gripper"]
    assert len(read_grasp_poses(_json(tmp_path / "mug.json", content))) == 2


def test_isaac_grasps_in_json(tmp_path: Path) -> None:
    w, *xyz = quaternion(POSES[0, :3, :3]).tolist()
    entry = {"confidence": 0.9, "position": POSES[0, :3, 3].tolist()}
    entry["orientation"] = {"w": w, "xyz": xyz}
    content = {"format": "isaac_grasp", "format_version": 1.0, "grasps": {"grasp_0": entry}}
    found = read_grasp_poses(_json(tmp_path / "a.json", content))
    assert found.form == "Isaac grasp" and found.names == ("grasp_0",)
    assert np.allclose(found.obj_T_hand, POSES[:1])
    entry["orientation"] = {"w": 2.0, "xyz": xyz}
    with pytest.raises(FormatError, match="grasp_0: the orientation has not length 1"):
        read_grasp_poses(_json(tmp_path / "a.json", content))


def test_plain_tables(tmp_path: Path) -> None:
    found = read_grasp_poses(_json(tmp_path / "a.json", POSES.tolist()))
    assert found.form == "table" and np.allclose(found.obj_T_hand, POSES)
    rows = "\n".join(",".join(map(repr, pose.ravel().tolist())) for pose in POSES)
    for head in ("", ",".join(f"m{k}" for k in range(16)) + "\n"):
        (tmp_path / "a.csv").write_text(head + rows + "\n", encoding="utf-8")
        found = read_grasp_poses(tmp_path / "a.csv")
        assert np.allclose(found.obj_T_hand, POSES)
        assert found.names[0] == ("line 2" if head else "line 1")


def test_rounded_rotations_are_made_exact(tmp_path: Path) -> None:
    turned = POSES[:1] + 2e-4
    turned[:, 3] = [0, 0, 0, 1]
    found = read_grasp_poses(_json(tmp_path / "a.json", turned.tolist()))
    rotation = found.obj_T_hand[0, :3, :3]
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ([(2 * np.eye(4)).tolist()], "grasp 0: the last row"),
        ([np.diag([2.0, 1, 1, 1]).tolist()], "grasp 0: is no rotation"),
        ([np.diag([-1.0, 1, 1, 1]).tolist()], "grasp 0: is no rotation"),
        ([POSES[0].T.tolist()], "transposed"),
        ([[1, 2, 3]], "grasp 0: should be 16 finite numbers"),
        ({"poses": []}, "grasps"),
        (7, "should hold a list of 4x4"),
        ({"grasps": {"transforms": POSES.tolist(), "object_in_gripper": [True]}}, "2 transforms"),
        ({"grasps": {"transforms": POSES.tolist(), "object_in_gripper": [0, 0]}}, "no grasp"),
        ([], "holds no grasp"),
        ([POSES[0, :3].tolist()], "grasp 0: has 12 numbers; a 4x4 matrix is needed"),
        (POSES[0].tolist(), "holds one 4x4 matrix"),
        ([[1, [2]], "a", {}], "grasp 0: should be 16 finite numbers"),
        ({"grasps": {"object_in_gripper": [True]}}, "grasps: no 'transforms'"),
        (
            {"grasps": {"transforms": POSES.tolist(), "object_in_gripper": [True, "false"]}},
            r"object_in_gripper\[1\]: 'false' is neither true nor false",
        ),
        (
            {"grasps": {"a": {"position": [0, 0, 0], "orientation": {"w": 0, "xyz": 5}}}},
            r"grasps.a.orientation.xyz: should be 3 finite numbers",
        ),
        (
            {"grasps": {"a": {"position": [0, 0], "orientation": {"w": 0, "xyz": [0, 0, 1]}}}},
            "grasps.a.position: should be 3 finite numbers",
        ),
    ],
)
def test_what_is_wrong_is_named(content: object, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        read_grasp_poses(_json(tmp_path / "a.json", content))


def test_other_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="write a YAML file as JSON"):
        read_grasp_poses(tmp_path / "a.yaml")
    with pytest.raises(InputError, match=r"are read from \.json and \.csv"):
        read_grasp_poses(tmp_path / "a.npz")
    (tmp_path / "a.csv").write_text("1,2\n", encoding="utf-8")
    with pytest.raises(FormatError, match="line 1: should be 16"):
        read_grasp_poses(tmp_path / "a.csv")


@pytest.mark.parametrize("mark", [";", " "])
def test_no_row_of_a_csv_file_is_taken_for_names(mark: str, tmp_path: Path) -> None:
    row = mark.join(map(str, POSES[0].ravel()))
    (tmp_path / "a.csv").write_text(f"{row}\n{row}\n", encoding="utf-8")
    with pytest.raises(FormatError, match="line 1: should be 16"):
        read_grasp_poses(tmp_path / "a.csv")
    (tmp_path / "b.csv").write_text("x" + row.replace(mark, ",") + "\n", encoding="utf-8")
    with pytest.raises(FormatError, match="line 1: should be 16"):
        read_grasp_poses(tmp_path / "b.csv")
