"""Camera motion from annotated poses."""

from __future__ import annotations

from numpy import ndarray
from numpy.testing import assert_allclose

from graspcast.paper.annotated_motion import camera_track
from graspcast.pose.transforms import invert
from static_scenes import objects, orbit, seen

CAMERAS = orbit(6)
POSES = seen(CAMERAS, objects(3))


def annotated(poses: ndarray) -> dict[int, dict[int, ndarray]]:
    return {i: dict(enumerate(row, start=1)) for i, row in enumerate(poses)}


def test_the_motion_is_relative_to_the_first_image() -> None:
    found = camera_track(annotated(POSES))
    assert found is not None
    for im_id, camera in enumerate(CAMERAS):
        assert_allclose(found[im_id], invert(CAMERAS[0]) @ camera, atol=1e-12)


def test_images_are_linked_by_the_objects_that_they_share() -> None:
    given = annotated(POSES)
    # The first image shows object 1 alone, the second 1 and 2, the third 2 alone.
    shown = {0: (1,), 1: (1, 2), 2: (2,)}
    found = camera_track({i: {o: given[i][o] for o in some} for i, some in shown.items()})
    assert found is not None
    assert_allclose(found[2], invert(CAMERAS[0]) @ CAMERAS[2], atol=1e-12)


def test_an_image_that_shares_no_object_has_no_pose() -> None:
    given = annotated(POSES)
    found = camera_track({0: {1: given[0][1]}, 1: {1: given[1][1]}, 2: {2: given[2][2]}, 3: {}})
    assert found is not None
    assert sorted(found) == [0, 1]


def test_rearranged_scenes_have_no_motion() -> None:
    given = annotated(POSES.copy())
    given[4][2][0, 3] += 0.01
    assert camera_track(given) is None
