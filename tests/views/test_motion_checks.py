"""Camera motion held against the estimates."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.bop.results import Results
from graspcast.errors import MismatchError
from graspcast.pose.transforms import invert
from graspcast.views.camera_motion import CameraMotion
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
    one = {"a": estimates_of(POSES[:1])}
    assert "no two images" in check_motion(one, motion_of(CAMERAS))
    few = {"a": estimates_of(POSES[:2])}
    assert "in 4 pairs of images alone" in check_motion(few, motion_of(CAMERAS))
    moved = orbit(12, degrees=-35.0, radius_m=1.1)
    assert "was an object moved" in check_motion(few, motion_of(moved))


@pytest.mark.parametrize(
    ("cameras", "says"),
    [(scaled(1e3), "in millimetres instead of metres"), (invert(CAMERAS), "the other direction")],
)
def test_two_images_are_enough_to_find_a_wrong_unit_or_direction(
    cameras: np.ndarray, says: str
) -> None:
    far = [0, 5]
    with pytest.raises(MismatchError, match=says):
        check_motion({"a": estimates_of(POSES[far])}, motion_of(cameras[far]))


@pytest.mark.parametrize(("scene_id", "first"), [(2, 0), (1, 100)])
def test_camera_poses_of_other_images_are_refused(scene_id: int, first: int) -> None:
    motion = CameraMotion.of([scene_id] * 12, list(range(first, first + 12)), CAMERAS)
    with pytest.raises(MismatchError, match=rf"image 1/0 and 11 others.* {scene_id}/{first} and"):
        check_motion(given(), motion)


@pytest.mark.parametrize(
    ("cameras", "says"),
    [
        (scaled(1e-3), "objects in scene 2 differ .*in metres instead of millimetres"),
        (invert(CAMERAS), "objects in scene 2 differ .*in the other direction"),
    ],
)
def test_one_scene_in_another_unit_or_direction_is_named(cameras: np.ndarray, says: str) -> None:
    scenes = [scattered(POSES, seed) for seed in range(3)]
    tables = [estimates_of(poses, scene_id=i + 1) for i, poses in enumerate(scenes)]
    motions = [CAMERAS, cameras, CAMERAS]
    images = [(i + 1, j) for i in range(3) for j in range(12)]
    motion = CameraMotion.of(*zip(*images, strict=True), np.concatenate(motions))
    with pytest.raises(MismatchError, match=says):
        check_motion({"a": joined(tables)}, motion)


def joined(tables: list[Results]) -> Results:
    names = ("scene_id", "im_id", "obj_id", "score", "cam_T_obj", "time_s", "line")
    return Results(**{n: np.concatenate([getattr(t, n) for t in tables]) for n in names})


@pytest.mark.parametrize("by_inverse", [False, True])
def test_a_rotation_of_one_direction_with_the_position_of_the_other(by_inverse: bool) -> None:
    cameras = invert(CAMERAS) if by_inverse else CAMERAS.copy()
    cameras[:, :3, :3] = cameras[:, :3, :3].transpose(0, 2, 1)
    with pytest.raises(MismatchError, match="each rotation transposed"):
        check_motion(given(), motion_of(invert(cameras) if by_inverse else cameras))


def test_instances_of_one_object_are_compared_too() -> None:
    def same_objects(motion: CameraMotion) -> str:
        return check_motion({"a": estimates_of(POSES, obj_ids=[1] * 4)}, motion)

    assert same_objects(motion_of(CAMERAS)) == ""
    with pytest.raises(MismatchError, match="in metres instead of millimetres"):
        same_objects(motion_of(scaled(1e-3)))
    with pytest.raises(MismatchError, match="in the other direction"):
        same_objects(motion_of(invert(CAMERAS)))


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


def test_looks_at_instances_of_one_object_are_compared_too() -> None:
    results = {"a": estimates_of(scattered(POSES, 1), obj_ids=[1] * 4)}
    assert "one object in two looks" not in check_looks(results, motion_of(CAMERAS), 11)
    with pytest.raises(MismatchError, match="in millimetres instead"):
        check_looks(results, motion_of(scaled(1e3)), 11)
