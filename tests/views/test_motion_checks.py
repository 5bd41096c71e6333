"""Camera motion held against the estimates."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.bop.results import Results
from graspcast.errors import MismatchError
from graspcast.pose.lengths import shown
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


def by_hand(poses: np.ndarray, cameras: np.ndarray, pairs: list[tuple[int, int]]) -> str:
    """The median disagreement of positions carried from the second image of each pair, in words."""
    shares, far = [], []
    for o in range(poses.shape[1]):
        for i, j in pairs:
            carried = (invert(cameras[i]) @ cameras[j] @ poses[j, o])[:3, 3]
            far.append(np.linalg.norm(poses[i, o, :3, 3]))
            shares.append(np.linalg.norm(carried - poses[i, o, :3, 3]) / far[-1])
    return shown(float(np.median(shares)) * float(np.median(far)))


HALVES = [(i, i + 6) for i in range(6)]
WITH_THE_LAST = [(11, i) for i in range(11)]
OTHER = orbit(12, degrees=-35.0, radius_m=1.1)


@pytest.mark.parametrize("looks", [False, True])
def test_the_disagreement_and_what_is_left_of_it_are_told(looks: bool) -> None:
    poses = scattered(POSES, 2)
    results, motion = {"a": estimates_of(poses)}, motion_of(scaled(1e3))
    pairs = WITH_THE_LAST if looks else HALVES
    now, then = (by_hand(poses, c, pairs) for c in (scaled(1e3), CAMERAS))
    what = "look" if looks else "image"
    with pytest.raises(MismatchError) as caught:
        check_looks(results, motion, 11) if looks else check_motion(results, motion)
    said = str(caught.value)
    assert (
        f"carried from {what} to {what}, positions of objects differ by a median of {now};" in said
    )
    assert f"in millimetres instead of metres, it would be {then}" in said
    assert caught.value.parameters == ("camera_poses", "world_T_cam")


def test_the_disagreement_with_another_scene_is_told() -> None:
    results = {"a": estimates_of(POSES)}
    with pytest.raises(MismatchError) as caught:
        check_motion(results, motion_of(OTHER))
    assert f"differ by a median of {by_hand(POSES, OTHER, HALVES)}, and no" in str(caught.value)
    said = check_looks(results, motion_of(OTHER), 11)
    assert f"differ by a median of {by_hand(POSES, OTHER, WITH_THE_LAST)}; was an object" in said


def test_of_many_images_forty_pairs_are_compared() -> None:
    """The first half of the images with the second, evenly."""
    many = orbit(170, degrees=2.0)
    poses = seen(many, objects(2))
    wrong = many.copy()
    wrong[1::2, :3, 3] *= 1e3  # every second image alone, which is not compared
    wrong[84::2] = many[84::2]
    results = {"a": estimates_of(poses)}
    assert check_motion(results, motion_of(many)) == ""
    compared = {i + half for i in range(0, 85, 2) for half in (0, 85)}
    some = many.copy()
    for i in set(range(170)) - compared:
        some[i, :3, 3] += 5.0
    assert check_motion(results, motion_of(some)) == ""
    for i in range(0, 85, 2):
        some[i, :3, 3] += 5.0
    with pytest.raises(MismatchError, match="contradict the estimates"):
        check_motion(results, motion_of(some))


def test_instances_that_are_not_in_every_image_are_compared_too() -> None:
    table = estimates_of(scattered(POSES, 1), obj_ids=[1] * 4)
    rows = np.random.default_rng(0).random(len(table)) < 0.7
    results = {"a": table.select(rows)}
    assert check_motion(results, motion_of(CAMERAS)) == ""
    assert "one object in two" not in check_looks(results, motion_of(CAMERAS), 11)
    with pytest.raises(MismatchError, match="in millimetres instead of metres"):
        check_motion(results, motion_of(scaled(1e3)))
    with pytest.raises(MismatchError, match="in millimetres instead of metres"):
        check_looks(results, motion_of(scaled(1e3)), 11)


def test_one_object_in_two_looks_is_said() -> None:
    alone = {"a": estimates_of(scattered(POSES[:2, :1], 1))}
    said = check_looks(alone, motion_of(CAMERAS[:2]), 1)
    assert said == "the camera poses were checked by one object in two looks alone"
    assert check_looks(alone, motion_of(CAMERAS[:1]), 0) == ""
    two_objects = {"a": estimates_of(scattered(POSES[:2, :2], 1))}
    assert check_looks(two_objects, motion_of(CAMERAS[:2]), 1) == ""
    three_looks = {"a": estimates_of(scattered(POSES[:3, :1], 1))}
    assert check_looks(three_looks, motion_of(CAMERAS[:3]), 2) == ""


@pytest.mark.parametrize("numbers", [[1, 1, 2, 3], [3, 3, 1, 2], [1, 2, 2, 3]])
def test_objects_that_are_alone_are_compared_beside_several_of_another(numbers: list[int]) -> None:
    """A pair of instances that are taken for one another is no disagreement."""
    poses = POSES.copy()
    twice = [i for i, number in enumerate(numbers) if numbers.count(number) > 1]
    poses[6:, twice, :3, 3] += [0.2, 0.0, 0.0]  # those have been moved, between the halves
    results = {"a": estimates_of(poses, obj_ids=numbers)}
    assert check_looks(results, motion_of(CAMERAS), 11) == ""
    assert check_motion(results, motion_of(CAMERAS)) == ""
    with pytest.raises(MismatchError, match="in millimetres instead of metres"):
        check_looks(results, motion_of(scaled(1e3)), 11)
