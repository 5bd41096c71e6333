"""Motion from the poses of other objects: true ones of rearranged scenes, and estimates."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy import ndarray

from graspcast.bop.dataset import GroundTruth
from graspcast.pose.transforms import compose, invert
from graspcast.views.motion import Motion, ViewMotions
from graspcast.views.object_motion import ObjectMotion
from static_scenes import estimates_of, objects, orbit, scattered, seen

CAMERAS = orbit(8)
POSES = seen(CAMERAS, objects(5))


def truth_of(poses: ndarray) -> GroundTruth:
    table = estimates_of(poses)
    n = len(table)
    return GroundTruth(
        table.scene_id, table.im_id, table.obj_id, np.zeros(n, int), table.cam_T_obj, np.ones(n)
    )


def views(motion: ObjectMotion, obj_id: int = 1, others: Any = range(1, 8)) -> ViewMotions:
    found = motion.views_of(1, 0, obj_id, list(others))
    assert found.refine is not None
    refined = found.refine(np.arange(len(found.im_id)))
    return replace(
        found, im_id=found.im_id[refined.serves], cam_T_view=refined.cam_T_view[refined.serves]
    )


def true_motion(im_id: ndarray) -> ndarray:
    return np.asarray(compose(invert(CAMERAS[:1]), CAMERAS[im_id]))


def rearranged() -> ndarray:
    """From image 4 on, objects 1, 2 and 3 have been moved together, the others not."""
    poses = POSES.copy()
    by = np.eye(4)
    by[:3, 3] = [0.3, 0.1, 0.0]
    poses[4:, :3] = seen(CAMERAS[4:], by @ objects(5)[:3])
    return poses


def test_a_known_motion_is_recovered() -> None:
    motion = ObjectMotion.from_ground_truth(truth_of(POSES))
    found = views(motion)
    assert found.im_id.tolist() == list(range(1, 8)) and not found.left_out
    np.testing.assert_allclose(found.cam_T_view, true_motion(found.im_id), atol=1e-9)
    assert isinstance(motion, Motion) and motion.scenes == {1}
    assert repr(motion) == "ObjectMotion(8 images of 1 scenes, ground truth)"


def test_in_rearranged_scenes_the_motion_is_that_of_the_objects_that_moved_along() -> None:
    motion = ObjectMotion.from_ground_truth(truth_of(rearranged()))
    with_it = views(motion, 1)
    assert with_it.im_id.tolist() == list(range(1, 8))
    carried = with_it.cam_T_view @ rearranged()[1:, 0]
    np.testing.assert_allclose(carried, np.broadcast_to(POSES[0, 0], carried.shape), atol=1e-9)
    # Of objects 4 and 5 only each other stayed: one is not enough.
    alone = views(motion, 4)
    assert alone.im_id.tolist() == [1, 2, 3]
    assert alone.left_out == {
        "since fewer than two other objects moved with the judged one": 4,
    }


def test_the_judged_objects_own_truth_does_not_enter_the_motion() -> None:
    before = views(ObjectMotion.from_ground_truth(truth_of(POSES)))
    shifted, gone = POSES.copy(), POSES.copy()
    shifted[3, 0, :3, 3] += 0.004
    after = views(ObjectMotion.from_ground_truth(truth_of(shifted)))
    np.testing.assert_array_equal(after.cam_T_view, before.cam_T_view)
    gone[3, 0, :3, 3] += 0.04
    without = views(ObjectMotion.from_ground_truth(truth_of(gone)))
    assert without.im_id.tolist() == [1, 2, 4, 5, 6, 7]
    np.testing.assert_array_equal(without.cam_T_view, before.cam_T_view[without.im_id - 1])


def test_the_judged_objects_own_estimates_do_not_enter_the_motion() -> None:
    noisy = scattered(POSES, 0)
    other = noisy.copy()
    other[:, 0] = scattered(POSES, 9)[:, 0]
    found = [
        views(ObjectMotion.from_estimates({"a": estimates_of(p)}, dataset="d"))
        for p in (noisy, other)
    ]
    np.testing.assert_array_equal(found[0].cam_T_view, found[1].cam_T_view)


def test_scenes_that_are_partly_annotated() -> None:
    truth = truth_of(POSES)
    rows = np.ones(len(truth.obj_id), dtype=bool)
    rows[(truth.im_id == 2) & (truth.obj_id > 2)] = False  # one other object is left
    rows[truth.im_id == 3] = False
    rows[(truth.im_id == 5) & (truth.obj_id == 1)] = False
    some = GroundTruth(
        *(
            c[rows]
            for c in (
                truth.scene_id,
                truth.im_id,
                truth.obj_id,
                truth.gt_id,
                truth.cam_T_obj,
                truth.visib_fract,
            )
        )
    )
    motion = ObjectMotion.from_ground_truth(some)
    assert views(motion).im_id.tolist() == [1, 4, 6, 7]
    assert motion.views_of(1, 3, 1, [0]).why == "are in images without an annotated object"
    assert motion.views_of(2, 0, 1, [1]).why == "are in images without an annotated object"
    assert motion.views_of(1, 5, 1, [0]).why == "are not annotated once in their image"
    twice = replace(truth, obj_id=np.where(truth.obj_id == 2, 1, truth.obj_id))
    motion = ObjectMotion.from_ground_truth(twice)
    assert motion.views_of(1, 0, 1, [1]).why == "are not annotated once in their image"
    assert views(motion, 3).im_id.tolist() == list(range(1, 8))  # by objects 4 and 5
