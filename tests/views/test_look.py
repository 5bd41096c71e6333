"""One look."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from graspcast.errors import InputError
from graspcast.pose.transforms import transform
from graspcast.views.look import Look
from graspcast.views.looks import fuse_looks
from static_scenes import objects, orbit, scattered, seen

CAMERAS = orbit(4, degrees=30.0)
FOUND = {name: scattered(seen(CAMERAS, objects(3)), seed) for seed, name in enumerate("abc")}
K = np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]])


def by_name(i: int, **given: Any) -> Look:
    """Look number i, at object 2 alone."""
    return Look({n: {"d-2": FOUND[n][i, 1]} for n in "abc"}, CAMERAS[i], **given)


@pytest.mark.ill_typed
def test_intrinsics_may_differ_and_are_checked() -> None:
    fuse_looks([by_name(0, K=K), by_name(1, K=K * [[2], [2], [1]]), by_name(2)])
    for wrong, says in (
        (K.T, "transposed"),
        (np.eye(4), "3x3"),
        (np.eye(3), "not in pixels"),
        ("K", "3x3"),
        (K * np.nan, "finite"),
    ):
        with pytest.raises(InputError, match=f"K .*{says}"):
            by_name(0, K=wrong)


@pytest.mark.ill_typed
@pytest.mark.parametrize(
    ("pose", "says"),
    [
        (np.eye(3), "4x4"),
        (np.full((4, 4), np.nan), "not finite"),
        (np.diag([1.0, 1, -1, 1]), "mirrored"),
        (np.diag([2.0, 2, 2, 1]), "scaled"),
        (CAMERAS[0].T, "last row"),
        (transform(np.eye(3), np.array([0, 0, 1e6])), "from the world's origin"),
    ],
)
def test_camera_poses_that_are_none_are_refused(pose: np.ndarray, says: str) -> None:
    with pytest.raises(InputError, match=f"world_T_cam .*{says}"):
        replace(by_name(0), world_T_cam=pose)


def test_a_look_says_what_it_holds() -> None:
    assert repr(by_name(0)) == "Look(3 estimates by a, b, c, with camera pose)"
    assert repr(Look({})) == "Look(0 estimates by no estimator, without camera pose)"
