"""Changed motions: errors of the stated size, motions of other images, views in a range."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from graspcast.evaluation.view_motions import DisturbedMotion, OtherImagesMotion, ParallaxMotion
from graspcast.pose.transforms import compose, invert, rotation_vector
from graspcast.views.camera_motion import CameraNoise
from graspcast.views.motion import Motion
from graspcast.views.object_motion import ObjectMotion
from static_scenes import estimates_of, motion_of, objects, orbit, seen

CAMERAS = orbit(24)
MOTION = motion_of(CAMERAS)
NOISE = CameraNoise(0.003, 0.005)
OTHERS = list(range(1, 24))


def errors(seed: int) -> np.ndarray:
    disturbed = DisturbedMotion(MOTION, NOISE, seed)
    out = []
    for image in range(24):
        others = [i for i in range(24) if i != image]
        true = MOTION.views_of(1, image, 1, others).cam_T_view
        out.append(compose(invert(true), disturbed.views_of(1, image, 1, others).cam_T_view))
    return np.concatenate(out)


def test_errors_have_the_stated_size() -> None:
    found = errors(0)
    turn = rotation_vector(found[:, :3, :3])
    assert_allclose(found[:, :3, 3].std(axis=0), NOISE.translation_m, rtol=0.1)
    assert_allclose(turn.std(axis=0), NOISE.rotation_rad, rtol=0.1)


def test_errors_depend_on_the_seed_and_not_on_which_other_images_serve() -> None:
    assert_array_equal(errors(0), errors(0))
    assert np.abs(errors(0) - errors(1)).max() > 1e-3
    disturbed = DisturbedMotion(MOTION, NOISE)
    every = disturbed.views_of(1, 0, 1, OTHERS)
    some = disturbed.views_of(1, 0, 2, [3, 20])
    assert_array_equal(some.cam_T_view, every.cam_T_view[[2, 19]])


def test_no_view_keeps_its_own_motion() -> None:
    true = MOTION.views_of(1, 0, 1, OTHERS).cam_T_view
    found = OtherImagesMotion(MOTION).views_of(1, 0, 1, OTHERS).cam_T_view
    assert (np.abs(found - true).max(axis=(1, 2)) > 1e-3).all()
    assert_allclose(np.sort(found[:, 0, 3]), np.sort(true[:, 0, 3]))


def test_views_lie_in_the_range_of_parallax() -> None:
    position = {(1, 0, 1): seen(CAMERAS, np.eye(4)[None])[0, 0, :3, 3]}
    motion = ParallaxMotion(MOTION, position, np.deg2rad(20), np.deg2rad(30))
    found = motion.views_of(1, 0, 1, OTHERS)
    # 15 degrees between neighbours, seen from 40 degrees above the horizon.
    assert found.im_id.tolist() == [2, 22]
    assert motion.views_of(1, 1, 1, [0, 2]).im_id.tolist() == [0, 2]  # no known position


def test_motion_that_is_refined_is_changed_alike() -> None:
    results = {"a": estimates_of(seen(CAMERAS, objects(4)))}
    rough: Motion = ObjectMotion.from_estimates(results, dataset="d")
    true = rough.views_of(1, 0, 1, OTHERS)
    disturbed = DisturbedMotion(rough, NOISE).views_of(1, 0, 1, OTHERS)
    chosen = np.array([3, 7])
    assert true.refine is not None and disturbed.refine is not None
    error = compose(invert(true.cam_T_view), disturbed.cam_T_view)
    expected = compose(true.refine(chosen).cam_T_view, error[chosen])
    assert_allclose(disturbed.refine(chosen).cam_T_view, expected, atol=1e-9)
    other = OtherImagesMotion(rough).views_of(1, 0, 1, OTHERS)
    assert other.refine is not None
    assert_allclose(other.refine(chosen).cam_T_view, other.cam_T_view[chosen], atol=1e-6)
    position = {(1, 0, 1): results["a"].cam_T_obj[0, :3, 3]}
    some = ParallaxMotion(rough, position, 0.3, 1.0).views_of(1, 0, 1, OTHERS)
    assert some.refine is not None and 1 < len(some.im_id) < len(OTHERS)
    assert_allclose(some.refine(np.array([1])).cam_T_view, some.cam_T_view[[1]], atol=1e-6)
