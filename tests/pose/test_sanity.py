"""Which poses cannot be those of an object seen by a camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import read_results
from graspcast.errors import InputError
from graspcast.pose.sanity import (
    FARTHEST_M,
    NEAREST_M,
    as_pose,
    is_placeholder,
    pose_problems,
    rotation_problem,
)
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


@pytest.mark.slow
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


@pytest.mark.parametrize("column", range(4))
@pytest.mark.parametrize("by", [1e-5, -1e-5, 1.0, -1.0])
def test_every_number_of_the_last_row_counts(column: int, by: float) -> None:
    pose = changed(t=T)
    pose[3, column] += by
    (said,) = pose_problems(pose[None], DIAMETER)
    assert said.startswith("has the last row ") and "transposed" not in said


def test_what_rounding_may_do_is_no_problem() -> None:
    pose = changed(R=R + np.random.default_rng(0).normal(scale=1e-3, size=(3, 3)), t=T)
    pose[3] += [9e-7, -9e-7, 0, 9e-7]
    assert pose_problems(pose[None], DIAMETER) == [""]


def test_a_rotation_may_be_off_by_two_hundredths() -> None:
    """In the Frobenius norm: a factor on all three axes counts with the root of three."""
    for factor in (1 + 0.019 / np.sqrt(3), 1 - 0.019 / np.sqrt(3)):
        assert pose_problems(changed(R=factor * R, t=T)[None], DIAMETER) == [""]
        assert rotation_problem(factor * R) == ""
    for factor in (1 + 0.021 / np.sqrt(3), 1 - 0.021 / np.sqrt(3)):
        (said,) = pose_problems(changed(R=factor * R, t=T)[None], DIAMETER)
        assert said == rotation_problem(factor * R) == f"has a rotation scaled by {factor:.4g}"
    stretched = R @ np.diag([1.0, 1.0, 1.03])
    assert rotation_problem(stretched) == "has a rotation that is no rotation matrix"
    assert rotation_problem(5 * stretched) == "has a rotation that is no rotation matrix"
    assert rotation_problem(5 * R @ np.diag([1.0, 1.0, 1.01])).startswith("has a rotation scaled")


@pytest.mark.parametrize("factor", [1.0, 0.995, 1.005])
def test_a_mirror_is_found_even_if_scaled_a_little(factor: float) -> None:
    (said,) = pose_problems(changed(R=-factor * R, t=T)[None], DIAMETER)
    assert "mirrored" in said


def test_the_size_of_what_is_behind_or_too_far_is_named() -> None:
    assert "(z = -0.8 m)" in pose_problems(changed(t=[0.1, 0.2, -0.8])[None], DIAMETER)[0]
    assert "behind" in pose_problems(changed(t=[0.5, 0.5, 0.0])[None], DIAMETER)[0]
    for factor, says in ((0.999, "that is"), (1.001, "")):
        near = changed(t=[0, 0, 0.1 * factor])
        assert pose_problems(near[None], DIAMETER)[0].partition("has a distance ")[2][:7] == says
        far = changed(t=[0, 0, 20.0 / factor])
        assert ("20 m away" in pose_problems(far[None], DIAMETER)[0]) == (factor < 1)


@pytest.mark.parametrize(
    ("metres", "sane"), [(0.0199, False), (0.0201, True), (19.9, True), (20.1, False)]
)
def test_of_unknown_size_the_distance_is_from_two_centimetres_to_twenty_metres(
    metres: float, sane: bool
) -> None:
    pose = changed(t=[0, 0, metres])[None]
    for size in (None, np.array([np.nan])):
        (said,) = pose_problems(pose, size)
        assert (said == "") == sane
        assert sane or "of unknown size should be 20 mm to 20 m away" in said


@pytest.mark.parametrize(("metres", "placeholder"), [(0.9e-9, True), (1.1e-9, False)])
def test_a_placeholder_is_at_the_cameras_centre(metres: float, placeholder: bool) -> None:
    for axis in range(3):
        t = np.zeros(3)
        t[axis] = -metres
        assert is_placeholder(changed(t=t)) == placeholder
        row = np.array([0.0, 0, 0, 1])
        row[axis] = metres
        assert is_placeholder(changed(t=np.zeros(3), row=row)) == placeholder


class Refusing:
    """A tensor that is on another device, say."""

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        raise RuntimeError("call .cpu() first")


def test_poses_may_be_given_as_lists_integers_or_masked() -> None:
    assert np.array_equal(as_pose("a", np.eye(4, dtype=int).tolist()), np.eye(4))
    assert as_pose("a", np.eye(4, dtype=np.float32)).dtype == np.float64
    assert np.array_equal(as_pose("a", np.eye(4).astype(object)), np.eye(4))
    masked = np.ma.masked_array(np.eye(4), mask=np.eye(4) > 0)
    found = as_pose("a", masked)
    assert np.isnan(found[np.eye(4) > 0]).all() and (found[np.eye(4) == 0] == 0).all()


@pytest.mark.parametrize(
    "given_pose",
    [
        np.eye(3),
        np.eye(5),
        np.zeros((3, 4)),
        np.zeros((4, 5)),
        np.zeros((5, 4)),
        np.zeros(16),
        np.eye(4)[None],
        np.eye(4, dtype=bool),
        np.eye(4).astype(str),
        np.eye(4, dtype=complex),
        [[1, 2], [3]],
        "eye",
        None,
        Refusing(),
    ],
)
def test_what_is_no_matrix_of_numbers_is_refused(given_pose: object) -> None:
    with pytest.raises(InputError, match="by someone is not a 4x4 matrix of numbers"):
        as_pose("someone", given_pose)


@pytest.mark.parametrize(
    ("diameters", "suggested"), [(0.99, False), (1.01, True), (29.9, True), (30.1, False)]
)
def test_a_unit_is_suggested_with_which_the_distance_is_usual(
    diameters: float, suggested: bool
) -> None:
    """From one to thirty diameters."""
    (said,) = pose_problems(changed(t=[0, 0, 1000 * 0.2 * diameters])[None], DIAMETER)
    assert ("is it in millimetres" in said) == suggested


def test_each_pose_of_a_batch_has_its_own_problem_and_diameter() -> None:
    poses = np.stack([changed(t=T), changed(t=-T), changed(t=T), changed(t=30 * T)])
    sizes = np.array([0.2, 0.2, 5.0, 1.0])
    said = pose_problems(poses, sizes)
    assert [bool(text) for text in said] == [False, True, True, False]
    assert "behind" in said[1] and "an object 5.00 m across" in said[2]


def test_a_scaled_matrix_is_not_called_transposed() -> None:
    (said,) = pose_problems(2 * np.eye(4)[None], DIAMETER)
    assert said == "has the last row 0 0 0 2, not 0 0 0 1"
