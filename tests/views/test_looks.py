"""Looks at a static scene, fused without files."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from graspcast.errors import GraspcastError, InputError, MismatchError, UnknownNameError
from graspcast.pose.transforms import invert, transform
from graspcast.views.camera_motion import CameraNoise
from graspcast.views.fused_estimates import FusedEstimates, fuse_estimates
from graspcast.views.look import Look
from graspcast.views.looks import fuse_looks, fuse_looks_by
from static_scenes import estimates_of, motion_of, objects, orbit, scattered, seen
from test_misuse import ODD

CAMERAS = orbit(4, degrees=30.0)
POSES = seen(CAMERAS, objects(3))
FOUND = {name: scattered(POSES, seed) for seed, name in enumerate("abc")}
K = np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]])


def by_name(i: int, *, who: str = "abc", cameras: np.ndarray = CAMERAS, **given: Any) -> Look:
    """Look number i, at object 2 alone."""
    return Look({n: {"d-2": FOUND[n][i, 1]} for n in who}, cameras[i], **given)


def by_results(i: int, **given: Any) -> Look:
    """Look number i, at all objects."""
    tables = {n: estimates_of(FOUND[n]) for n in "abc"}
    return Look({n: t.select(t.im_id == i) for n, t in tables.items()}, CAMERAS[i], **given)


def error_mm(found: FusedEstimates, image: int, obj: int = 1) -> float:
    t = found.poses.cam_T_obj[0, :3, 3] - POSES[image, obj, :3, 3]
    return float(1e3 * np.linalg.norm(t))


def test_looks_are_fused_as_a_table_of_the_same_images() -> None:
    tables = {n: estimates_of(FOUND[n]) for n in "abc"}
    noise = CameraNoise(0.001, 0.002)
    whole = fuse_estimates(tables, motion_of(CAMERAS), dataset="d", noise=noise)
    mine = fuse_looks([by_results(i) for i in range(4)], dataset="d", noise=noise)
    last = whole.instances.im_id == 3
    assert mine.instances.to_keys() == whole.instances.select(last).to_keys()
    np.testing.assert_allclose(mine.poses.cam_T_obj, whole.poses.cam_T_obj[last], atol=1e-12)
    np.testing.assert_allclose(mine.poses.covariance, whole.poses.covariance[last], atol=1e-12)
    np.testing.assert_array_equal(mine.gathered.view_im_id, whole.gathered.view_im_id[last])


def test_one_object_by_name() -> None:
    errors = []
    for count in (1, 2, 3):
        found = fuse_looks([by_name(i) for i in range(count)])
        assert found.instances.to_keys() == [("d", 0, count - 1, 2, 0)]
        assert found.views.tolist() == [count]
        assert found.estimators == ("a", "b", "c")
        errors.append(error_mm(found, count - 1))
    assert errors[2] < errors[0]
    assert "checked by one object in two looks" in fuse_looks([by_name(0), by_name(1)]).notes[0]
    assert fuse_looks([by_name(i) for i in range(3)]).notes == ()


def test_one_estimator_is_enough_and_they_may_differ_between_looks() -> None:
    alone = fuse_looks([by_name(i, who="b") for i in range(3)])
    assert (alone.principal, alone.views.tolist()) == ("b", [3])
    mixed = fuse_looks([by_name(0, who="a"), by_name(1, who="bc"), by_name(2, who="c")])
    assert (mixed.estimators, mixed.principal) == (("a", "b", "c"), "c")
    assert mixed.poses.used[0].sum() == 4


def test_the_principal_is_the_first_with_an_estimate() -> None:
    last = Look({"a": {"d-2": None}, "b": {"d-2": FOUND["b"][1, 1]}}, CAMERAS[1])
    assert fuse_looks([by_name(0), last]).principal == "b"
    with pytest.raises(InputError, match="no estimate in the last look by a"):
        fuse_looks([by_name(0), last], principal="a")
    with pytest.raises(UnknownNameError, match="'z'"):
        fuse_looks([by_name(0)], principal="z")


def test_each_object_may_have_another_principal() -> None:
    whole = by_results(1).estimates
    fewer = {"a": whole["a"].select(whole["a"].obj_id != 2), "b": whole["b"], "c": whole["c"]}
    looks = [by_results(0), Look(fewer, CAMERAS[1])]
    first, second = fuse_looks_by(looks, ["a", "c", "b"], dataset="d")
    assert (first.principal, first.instances.obj_id.tolist()) == ("a", [1, 3])
    assert (second.principal, second.instances.obj_id.tolist()) == ("c", [2])
    assert first.views.tolist() == [2, 2]
    assert second.views.tolist() == [2]
    alone = fuse_looks(looks, dataset="d", principal="c")
    np.testing.assert_array_equal(second.poses.cam_T_obj[0], alone.poses.cam_T_obj[1])
    assert fuse_looks_by([by_name(0), Look({}, CAMERAS[1])], ["a", "b"]) == []


def test_a_pose_that_cannot_be_is_no_estimate_and_is_said() -> None:
    wrong = FOUND["a"][1, 1].copy()
    wrong[2, 3] *= -1
    last = Look({"a": {"d-2": wrong}, "b": {"d-2": FOUND["b"][1, 1]}}, CAMERAS[1])
    found = fuse_looks([by_name(0), last], principal="b")
    assert any("poses by a cannot be: one lies behind the camera" in note for note in found.notes)
    with pytest.raises(InputError, match=r"no estimate in the last look by a: .*behind"):
        fuse_looks([by_name(0), last], principal="a")


def test_a_look_without_estimates_is_said() -> None:
    nothing = Look({"a": {"d-2": None}}, CAMERAS[1])
    found = fuse_looks([by_name(0), nothing, by_name(2)])
    assert found.views.tolist() == [2]
    assert "no estimate in look 1" in found.notes
    with pytest.raises(InputError, match="no estimate"):
        fuse_looks([by_name(0), nothing])
    with pytest.raises(InputError, match="no estimate"):
        fuse_looks([nothing])


def test_looks_from_the_same_place_are_single_views() -> None:
    again = {n: {"d-2": scattered(POSES, 9 + i)[0, 1]} for i, n in enumerate("abc")}
    found = fuse_looks([by_name(0), Look(again, CAMERAS[0])])
    assert found.views.tolist() == [1]
    assert any("parallax too small" in line for line in found.summary())


def test_looks_at_other_objects_do_not_serve() -> None:
    other = Look({n: {"d-1": FOUND[n][0, 0]} for n in "abc"}, CAMERAS[0])
    found = fuse_looks([other, by_name(1)])
    assert found.views.tolist() == [1]
    assert any("no object is in another look too" in note for note in found.notes)
    assert any("no earlier image with an estimate" in line for line in found.summary())


def test_without_camera_poses_looks_are_single_views() -> None:
    found = fuse_looks([replace_camera(by_name(0), None), replace_camera(by_name(1), None)])
    assert found.views.tolist() == [1]
    found = fuse_looks([by_name(0), replace_camera(by_name(1), None)])
    assert found.views.tolist() == [1]
    assert any("1 instance has no camera pose" in line for line in found.summary())


def replace_camera(look: Look, pose: Any) -> Look:
    return replace(look, world_T_cam=pose)


def changed(pose: np.ndarray, **given: float) -> np.ndarray:
    out = pose.copy()
    out[:3, 3] *= given.get("scale", 1.0)
    return out


@pytest.mark.parametrize("who", ["a", "abc"])
@pytest.mark.parametrize(
    ("read", "says"),
    [
        (invert, "read in the other direction"),
        (lambda p: changed(p, scale=1e3), "in millimetres instead of metres"),
        (lambda p: changed(p, scale=0.01), "in metres instead of centimetres"),
        (lambda p: p @ np.diag([1.0, -1, -1, 1]), "look along -z"),
    ],
)
def test_wrong_readings_of_the_camera_poses_are_named(who: str, read: Any, says: str) -> None:
    cameras = np.stack([read(pose) for pose in CAMERAS])
    # With the world's origin elsewhere, as a robot's base is.
    cameras = np.stack([read(transform(np.eye(3), np.array([0.5, 0.2, 0.1])) @ p) for p in CAMERAS])
    with pytest.raises(MismatchError, match=says):
        fuse_looks([by_name(i, who=who, cameras=cameras) for i in range(2)])


def test_a_moved_object_is_said_and_does_not_spoil_the_pose() -> None:
    moved = {n: {"d-2": FOUND[n][1, 1].copy()} for n in "abc"}
    for poses in moved.values():
        poses["d-2"][:3, 3] += [0.25, 0.0, 0.1]
    found = fuse_looks([by_name(0), Look(moved, CAMERAS[1])])
    assert any("was an object moved" in note for note in found.notes)
    assert found.views.tolist() == [1]
    np.testing.assert_allclose(
        found.poses.cam_T_obj[0, :3, 3], POSES[1, 1, :3, 3] + [0.25, 0.0, 0.1], atol=0.02
    )


def test_time_goes_forward() -> None:
    fuse_looks([by_name(0, time_s=1.0), by_name(1), by_name(2, time_s=2.0)])
    for times in ((2.0, 1.0), (1.0, 1.0)):
        with pytest.raises(InputError, match=r"look 1 was at .* times should increase"):
            fuse_looks([by_name(i, time_s=t) for i, t in enumerate(times)])


@pytest.mark.ill_typed
def test_what_does_not_belong_together_is_refused() -> None:
    one = by_results(0)
    other = {n: replace(t, scene_id=t.scene_id + 1) for n, t in one.estimates.items()}
    with pytest.raises(InputError, match=r"different scenes \(1, 2\)"):
        fuse_looks([one, Look(other, CAMERAS[1])], dataset="d")
    with pytest.raises(InputError, match="different datasets: d, e"):
        fuse_looks([by_name(0), Look({"a": {"e-2": FOUND["a"][1, 1]}}, CAMERAS[1])])
    with pytest.raises(InputError, match="do not state their dataset"):
        fuse_looks([one])
    with pytest.raises(InputError, match=r"results are of 4 images \(1/0, 1/1"):
        Look({"a": estimates_of(FOUND["a"])}, CAMERAS[0])
    with pytest.raises(InputError, match="there is no look to fuse"):
        fuse_looks([])
    with pytest.raises(InputError, match="whole number"):
        fuse_looks([by_name(0)], max_views=2.5)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="objects are given by name"):
        Look({"a": {5: FOUND["a"][0, 0]}})
    with pytest.raises(InputError, match="pose by a of d-2 is not a 4x4"):
        Look({"a": {"d-2": np.eye(3)}})


def test_the_instances_keep_scene_and_image_of_the_results() -> None:
    tables = {n: replace(t, im_id=t.im_id + 700) for n, t in by_results(1).estimates.items()}
    found = fuse_looks([by_results(0), Look(tables, CAMERAS[1])], dataset="d")
    assert found.instances.im_id.tolist() == [701] * 3
    assert found.instances.scene_id.tolist() == [1] * 3
    assert found.gathered.view_im_id.tolist() == [[701, 0]] * 3


@pytest.mark.ill_typed
@pytest.mark.parametrize("odd", ODD, ids=lambda x: f"{type(x).__name__} {str(x)[:12]}")
def test_whatever_is_given_the_answer_is_a_result_or_an_error(odd: Any) -> None:
    calls = [
        lambda: fuse_looks([Look(odd, CAMERAS[0])]),
        lambda: fuse_looks([Look({"a": odd}, CAMERAS[0])], dataset="d"),
        lambda: fuse_looks([Look({"a": {"d-2": odd}}, CAMERAS[0])]),
        lambda: fuse_looks([by_name(0), replace_camera(by_name(1), odd)]),
        lambda: by_name(0, K=odd),
        lambda: fuse_looks([by_name(0), by_name(1, time_s=odd)]),
        lambda: fuse_looks(odd),
        lambda: fuse_looks([odd]),
        *(
            lambda name=name: fuse_looks([by_name(0), by_name(1)], **{name: odd})  # type: ignore[misc]
            for name in (
                "dataset",
                "principal",
                "models",
                "noise",
                "max_views",
                "min_parallax_rad",
                "spreads",
            )
        ),
    ]
    for call in calls:
        with suppress(GraspcastError):
            call()
