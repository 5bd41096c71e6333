"""Numbers of instances that stay the same from look to look."""

from __future__ import annotations

from typing import Any

import numpy as np

from graspcast.views.fused_estimates import FusedEstimates
from graspcast.views.look import Look
from graspcast.views.looks import fuse_looks
from graspcast.views.tracks import Tracks, turned
from static_scenes import estimates_of, objects, orbit, scattered, seen

CAMERAS = orbit(4, degrees=25.0)


def fused(places: np.ndarray, image: int, *, order: Any = None, seed: int = 0) -> FusedEstimates:
    """One look at instances of object 1 at these places (world frame, metres)."""
    world_T_obj = objects(len(places), 3)
    world_T_obj[:, :3, 3] = places
    poses = scattered(seen(CAMERAS, world_T_obj), seed)[image : image + 1]
    poses = poses if order is None else poses[:, order]
    table = estimates_of(poses, obj_ids=[1] * poses.shape[1])
    return fuse_looks([Look({"a": table}, CAMERAS[image])], dataset="d")


APART = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.2, 0.0]])


def test_instances_keep_their_numbers() -> None:
    tracks = Tracks()
    assert tracks.follow(fused(APART, 0), CAMERAS[0]) == ([0, 1, 2], [""] * 3)
    assert tracks.follow(fused(APART, 1, order=[2, 0, 1], seed=1), CAMERAS[1])[0] == [2, 0, 1]
    assert tracks.follow(fused(APART[1:2], 2, seed=2), CAMERAS[2])[0] == [1]  # others not seen
    assert tracks.follow(fused(APART, 3, seed=3), CAMERAS[3])[0] == [0, 1, 2]
    assert [track.number for track in tracks.of("d-1")] == [0, 1, 2]


def test_new_instances_get_new_numbers() -> None:
    tracks = Tracks()
    tracks.follow(fused(APART[:2], 0), CAMERAS[0])
    numbers, said = tracks.follow(fused(APART, 1, seed=1), CAMERAS[1])
    assert (numbers, said) == ([0, 1, 2], [""] * 3)


def test_doubt_is_said_and_does_not_last() -> None:
    near = np.array([[0.0, 0.0, 0.0], [0.008, 0.0, 0.0]])
    tracks = Tracks()
    same = objects(1, 3)[0, :3, :3]
    for image in range(2):
        world_T_obj = objects(2, 3)
        world_T_obj[:, :3, :3], world_T_obj[:, :3, 3] = same, near
        poses = seen(CAMERAS, world_T_obj)[image : image + 1]
        table = estimates_of(poses, obj_ids=[1, 1])
        look = fuse_looks([Look({"a": table}, CAMERAS[image])], dataset="d")
        numbers, said = tracks.follow(look, CAMERAS[image])
    assert numbers == [2, 3]
    assert all("not sure which of several" in text for text in said)
    assert len(tracks.of("d-1")) == 2


def test_a_single_instance_keeps_its_number_wherever_it_is() -> None:
    tracks = Tracks()
    tracks.follow(fused(APART[:1], 0), CAMERAS[0])
    assert tracks.follow(fused(APART[1:2], 1), None) == ([0], [""])


def test_without_camera_poses_several_are_in_doubt() -> None:
    tracks = Tracks()
    assert tracks.follow(fused(APART, 0), None) == ([0, 1, 2], [""] * 3)
    numbers, said = tracks.follow(fused(APART, 1), None)
    assert numbers == [3, 4, 5]
    assert all(said)


def test_a_copy_goes_its_own_way() -> None:
    tracks = Tracks()
    tracks.copy().follow(fused(APART, 0), CAMERAS[0])
    assert tracks.of("d-1") == []


def test_covariances_turn() -> None:
    R = CAMERAS[0][:3, :3]
    out = turned(np.diag([1.0, 2, 3, 4, 5, 6]), R)
    np.testing.assert_allclose(out[:3, :3], R @ np.diag([1.0, 2, 3]) @ R.T)
    np.testing.assert_allclose(out[3:, 3:], R @ np.diag([4.0, 5, 6]) @ R.T)


def test_a_look_without_a_camera_pose_after_one_with_it_is_in_doubt() -> None:
    tracks = Tracks()
    tracks.follow(fused(APART, 0), CAMERAS[0])
    numbers, said = tracks.follow(fused(APART, 1), None)
    assert numbers == [3, 4, 5]
    assert len(said) == 3 and all("not sure which of several" in text for text in said)
    # Those whose places are known are kept, and found again.
    assert tracks.follow(fused(APART, 2, seed=2), CAMERAS[2])[0][:1] != [3]


def test_one_of_several_and_several_of_one() -> None:
    """The only instance of a look is the nearest of those before; a second one is new."""
    tracks = Tracks()
    tracks.follow(fused(APART[:2], 0), CAMERAS[0])
    assert tracks.follow(fused(APART[1:2], 1), CAMERAS[1]) == ([1], [""])
    alone = Tracks()
    alone.follow(fused(APART[:1], 0), CAMERAS[0])
    assert alone.follow(fused(APART[[1, 0]], 1), CAMERAS[1]) == ([1, 0], [""] * 2)
    empty = Tracks()
    empty.follow(fused(APART[:1], 0), None)
    numbers, said = empty.follow(fused(APART[:2], 1), None)
    assert numbers == [1, 2] and all(said)
    assert empty.follow(fused(APART[:1], 2), None)[0] == [3]


def test_places_are_kept_in_the_world() -> None:
    tracks = Tracks()
    look = fused(APART, 0)
    tracks.follow(look, CAMERAS[0])
    for i, track in enumerate(tracks.of("d-1")):
        assert track.world_T_obj is not None
        np.testing.assert_allclose(track.world_T_obj, CAMERAS[0] @ look.poses.cam_T_obj[i])
        R = CAMERAS[0][:3, :3]
        position = R @ look.poses.covariance[i, :3, :3] @ R.T
        np.testing.assert_allclose(track.covariance[:3, :3], position)
