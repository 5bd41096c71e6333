"""Several estimators' poses are checked before they are compared."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.errors import InputError, MismatchError
from graspcast.estimates.checks import (
    copied,
    no_estimate_by,
    refuse_conventions,
    refuse_copies,
    refused,
)
from graspcast.pose.sanity import pose_problems
from graspcast.pose.transforms import invert
from poses import nudged, random_poses, results_of


def test_one_pose_of_two_names_is_found_for_each_instance() -> None:
    poses = random_poses(3)
    other = nudged(poses, 1)
    other[1] = poses[1]
    assert [bool(text) for text in copied("ab", np.stack([poses, other]))] == [False, True, False]
    refuse_copies("ab", np.stack([poses, other]))
    for near in (poses.astype(np.float32).astype(float), np.round(poses, 7), poses + 1e-15):
        assert all(copied("ab", np.stack([poses, near])))
        with pytest.raises(InputError, match="b has the same pose as a"):
            refuse_copies("ab", np.stack([poses, near]))
    assert not any(copied("ab", np.stack([poses, nudged(poses, 1, metres=1e-3, radians=1e-3)])))
    with pytest.raises(InputError, match="b has the same pose as a in each of 3 instances"):
        refuse_copies("ab", np.stack([poses, poses.copy()]))


def test_who_lacks_an_estimate_and_why() -> None:
    assert no_estimate_by(["a"], {}) == "no estimate by a"
    said = no_estimate_by(["a", "b"], {"b": "is far"})
    assert said == "no estimate by a, b (its pose is far)"


def test_poses_that_cannot_be_are_counted_by_their_most_common_fault() -> None:
    poses = random_poses(8)
    assert refused("a", results_of(poses), pose_problems(poses)) == ""
    poses[:2] = poses[:2] @ np.diag([1.0, 1, -1, 1])
    poses[2:5] = np.diag([1.0, -1, -1, 1]) @ poses[2:5]
    poses[5, :3, 3] = 0
    said = refused("a", results_of(poses), pose_problems(poses))
    assert said.startswith("5 of 8 poses by a cannot be: one lies behind the camera (z = -")
    assert said.endswith("; 3 of 8 poses lie behind it: are they obj_T_cam instead of cam_T_obj?")


def test_another_convention_is_refused() -> None:
    poses = random_poses(10)
    numbers = np.full(10, 1)
    refuse_conventions("ab", np.stack([poses, nudged(poses, 1)]), numbers, None)
    with pytest.raises(MismatchError, match="when inverted"):
        refuse_conventions("ab", np.stack([poses, invert(poses)]), numbers, None)
