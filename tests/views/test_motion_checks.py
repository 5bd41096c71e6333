"""Camera motion held against the estimates."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.bop.results import Results
from graspcast.errors import MismatchError
from graspcast.pose.transforms import invert
from graspcast.views.motion_checks import check_looks, check_motion
from static_scenes import estimates_of, motion_of, objects, orbit, scattered, seen

CAMERAS = orbit(12)
POSES = seen(CAMERAS, objects())


def given(seed: int = 0) -> dict[str, Results]:
    return {
        "a": estimates_of(scattered(POSES, seed)),
        "b": estimates_of(scattered(POSES, seed + 9)),
    }


def scaled(by: float) -> np.ndarray:
    out = CAMERAS.copy()
    out[:, :3, 3] *= by
    return out


@pytest.mark.parametrize("seed", range(5))
def test_motion_that_fits_is_accepted(seed: int) -> None:
    assert check_motion(given(seed), motion_of(CAMERAS)) == ""


@pytest.mark.parametrize(
    ("cameras", "says"),
    [
        (scaled(1e3), "in millimetres instead of metres"),
        (scaled(1e-3), "in metres instead of millimetres"),
        (scaled(100), "in centimetres instead of metres"),
        (invert(CAMERAS), "read in the other direction"),
        (CAMERAS @ np.diag([1.0, -1.0, -1.0, 1.0]), "look along -z"),
        (invert(scaled(1e3)), "in the other direction .* and with translations in millimetres"),
    ],
)
def test_wrong_units_and_directions_are_named(cameras: np.ndarray, says: str) -> None:
    with pytest.raises(MismatchError, match=says):
        check_motion(given(), motion_of(cameras))


def test_the_motion_of_another_scene_is_found() -> None:
    other = orbit(12, degrees=-35.0, radius_m=1.1)
    with pytest.raises(MismatchError, match=r"in scene 1 .*of another scene, were objects moved"):
        check_motion(given(), motion_of(other))


def test_some_moved_objects_and_gross_errors_are_no_contradiction() -> None:
    results = given()
    poses = results["a"].cam_T_obj.copy()
    poses[::4, :3, 3] += 0.3
    results["a"] = estimates_of(poses.reshape(POSES.shape))
    assert check_motion(results, motion_of(CAMERAS)) == ""


def test_too_little_to_compare_is_said() -> None:
    few = {"a": estimates_of(POSES[:2])}
    assert "not compared with the estimates" in check_motion(few, motion_of(CAMERAS))
    assert "only 0 pairs" in check_motion(given(), motion_of(CAMERAS, scene_id=2))


def test_a_camera_that_stands_still_contradicts_nothing() -> None:
    still = np.repeat(CAMERAS[:1], 12, axis=0)
    poses = seen(still, objects())
    assert check_motion({"a": estimates_of(scattered(poses, 1))}, motion_of(still)) == ""


def test_looks_are_compared_with_the_last_one() -> None:
    assert check_looks(given(), motion_of(CAMERAS), 11) == ""
    assert check_looks(given(), motion_of(CAMERAS[:5]), 11) == ""  # no camera pose of look 11
    with pytest.raises(MismatchError, match=r"from look to look, .*in millimetres instead"):
        check_looks(given(), motion_of(scaled(1e3)), 11)
    of_one = {"a": given()["a"].select(np.array([0, 5]))}  # object 1 in image 0, object 2 in 1
    assert "no object is in another look" in check_looks(of_one, motion_of(CAMERAS), 1)
    other = orbit(12, degrees=-35.0, radius_m=1.1)
    assert "was an object moved" in check_looks(given(), motion_of(other), 11)
