"""Motion from the poses of other objects: true ones of rearranged scenes, and estimates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy import ndarray
from scipy.spatial.transform import Rotation

from graspcast.bop.dataset import BopDataset, GroundTruth
from graspcast.bop.results import read_results
from graspcast.errors import InputError, MismatchError
from graspcast.pose.transforms import compose, invert, skew
from graspcast.views.fused_estimates import FusedEstimates, fuse_estimates
from graspcast.views.motion import Motion, ViewMotions
from graspcast.views.object_consensus import ObjectPoses, fit_motion
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
    assert repr(motion) == "ObjectMotion(8 images of 1 scene, ground truth)"


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


def estimated(poses: ndarray, **given: Any) -> FusedEstimates:
    results = {"a": estimates_of(poses)}
    motion = ObjectMotion.from_estimates(results, dataset="d")
    return fuse_estimates(results, motion, dataset="d", views_from="all", **given)


@pytest.mark.slow
def test_estimates_of_other_objects_state_the_motion() -> None:
    """The fused positions are better than those of one view, and their covariances hold."""
    gains, chi = [], []
    for seed in range(4):
        true = seen(CAMERAS, objects(6, seed))
        found = estimated(scattered(true, seed))
        alone = estimated(scattered(true, seed), max_views=1)
        assert (found.views == 3).mean() > 0.8
        mine = true[found.instances.im_id, found.instances.obj_id - 1, :3, 3]
        offset = mine - found.poses.cam_T_obj[:, :3, 3]
        inverse = np.linalg.inv(found.poses.covariance[:, :3, :3])
        chi += np.einsum("ni,nij,nj->n", offset, inverse, offset).tolist()
        one = np.linalg.norm(mine - alone.poses.cam_T_obj[:, :3, 3], axis=1)
        gains.append(np.median(np.linalg.norm(offset, axis=1)) / np.median(one))
        assert found.gathered.motion_covariance[:, 1:].any(axis=(1, 2, 3)).all()
        assert not found.gathered.motion_covariance[:, 0].any()
    assert np.mean(gains) < 0.85
    assert 0.4 < np.median(chi) / 2.366 < 2.0


def test_an_object_that_was_moved_never_loses_its_own_image() -> None:
    poses = scattered(POSES, 3)
    poses[0, 0, :3, 3] += [0.15, 0.0, 0.0]
    found = estimated(poses)
    row = int(np.flatnonzero((found.instances.im_id == 0) & (found.instances.obj_id == 1))[0])
    assert found.poses.used[row, 0].all() and found.poses.dropped[row, 1:].all()
    np.testing.assert_allclose(found.poses.cam_T_obj[row], poses[0, 0], atol=1e-9)


@pytest.mark.parametrize("n", [1, 2])
def test_fewer_than_two_other_objects_serve_for_nothing(n: int) -> None:
    found = estimated(scattered(seen(CAMERAS, objects(n)), 0))
    assert (found.views == 1).all() and not found.gathered.motion_covariance.any()
    lines = found.summary()
    assert (
        f"left out {8 * n * 7} views since fewer than two other objects agree on the motion"
        in lines
    )
    assert any("have no view, since fewer than two other" in line for line in lines)


def test_objects_that_disagree_serve_for_nothing() -> None:
    rng = np.random.default_rng(0)
    poses = POSES.copy()
    poses[..., :3, 3] += rng.normal(0, 0.3, (8, 5, 3)) * [1, 1, 0]
    assert (estimated(poses).views == 1).mean() > 0.9


def revolution(n: int) -> ndarray:
    out = np.tile(np.eye(4), (n, 1, 1))
    angle = 2 * np.pi * np.arange(n) / n
    out[:, 0, 0] = out[:, 1, 1] = np.cos(angle)
    out[:, 1, 0], out[:, 0, 1] = np.sin(angle), -np.sin(angle)
    return out


@pytest.mark.parametrize(("n", "serves"), [(2, True), (64, False)])
def test_symmetric_objects_alone(n: int, serves: bool) -> None:
    """Half turns are resolved by the others; a figure of revolution does not say how it turned."""
    rng = np.random.default_rng(1)
    symmetry = revolution(n)
    poses = POSES @ symmetry[rng.integers(n, size=(8, 5))]
    truth = truth_of(poses)
    motion = ObjectMotion(
        ObjectMotion.from_ground_truth(truth)._tables,
        dict.fromkeys(range(1, 6), symmetry),
        "test",
        true=True,
    )
    found = motion.views_of(1, 0, 1, list(range(1, 8)))
    assert (len(found.im_id) == 7) == serves
    if serves:
        found = views(motion)
        np.testing.assert_allclose(found.cam_T_view, true_motion(found.im_id), atol=1e-9)
    else:
        assert found.left_out == {"since fewer than two other objects moved with the judged one": 7}


def test_duplicates_make_no_difference() -> None:
    poses = scattered(POSES, 5)
    once = estimates_of(poses)
    twice = {
        "a": estimates_of(np.concatenate([poses, poses[:, 1:2]], 1), obj_ids=[1, 2, 3, 4, 5, 2])
    }
    found = [
        views(ObjectMotion.from_estimates(results, dataset="d")) for results in ({"a": once}, twice)
    ]
    np.testing.assert_allclose(found[0].cam_T_view, found[1].cam_T_view, atol=1e-9)


def test_no_estimate_and_other_scenes_are_refused() -> None:
    none = estimates_of(POSES).select(np.zeros(40, bool))
    with pytest.raises(InputError, match="no estimate to take the motion from"):
        ObjectMotion.from_estimates({"a": none}, dataset="d")
    other = ObjectMotion.from_estimates({"a": estimates_of(POSES, scene_id=9)}, dataset="d")
    assert len(other.views_of(1, 0, 1, [1]).im_id) == 0
    with pytest.raises(MismatchError, match="of other scenes"):
        fuse_estimates({"a": estimates_of(POSES)}, other, dataset="d")


@pytest.mark.slow
def test_published_estimates_of_rearranged_scenes(published: Path) -> None:
    """LM-O: most instances have a view, and errors in its three views are half as large."""
    root = published / "lmo"
    tables = {n: read_results(root / f"{n}_lmo-test.csv") for n in ("zebrapose", "gdrnpp", "epos")}
    dataset = BopDataset(published.parent / "bop" / "lmo", ground_truth=root / "ground_truth")
    truth, models = dataset.ground_truth, {"lmo": dataset.models}
    place = {
        key: i
        for i, key in enumerate(zip(truth.im_id.tolist(), truth.obj_id.tolist(), strict=True))
    }

    def median_error(motion: ObjectMotion | None) -> float:
        found = fuse_estimates(tables, motion, dataset="lmo", models=models, views_from="all")
        if motion is not None and not motion.estimated:
            assert (found.gathered.present.any(axis=2).sum(axis=1) > 1).mean() > 0.9
        keys = zip(found.instances.im_id.tolist(), found.instances.obj_id.tolist(), strict=True)
        row = np.array([place.get(key, -1) for key in keys])
        offset = truth.cam_T_obj[row, :3, 3] - found.poses.cam_T_obj[:, :3, 3]
        return float(np.median(np.linalg.norm(offset[row >= 0], axis=1)))

    one = median_error(None)
    assert median_error(ObjectMotion.from_ground_truth(truth, dataset.models)) < 0.6 * one
    estimated = ObjectMotion.from_estimates(tables, dataset="lmo", models=models)
    assert median_error(estimated) < 0.9 * one


def test_images_that_do_not_serve_have_empty_motions() -> None:
    motion = ObjectMotion.from_ground_truth(truth_of(POSES))
    none = motion.views_of(2, 0, 1, [1])
    assert (none.im_id.shape, none.cam_T_view.shape, none.noise.shape) == ((0,), (0, 4, 4), (0, 2))
    some = motion.views_of(1, 0, 1, [1, 2, 99])
    assert some.im_id.tolist() == [1, 2] and some.noise.shape == (2, 2)
    assert some.left_out == {"since fewer than two other objects moved with the judged one": 1}
    assert some.why == ""
    nothing = motion.views_of(1, 0, 1, [])
    assert (nothing.why, nothing.left_out) == ("", {})
    assert motion.views_of(1, 0, 1, [99]).why.startswith("have no view, since fewer than two")


def test_scenes_do_not_mix() -> None:
    """Images and objects have the same numbers in both."""
    other = seen(CAMERAS, objects(5, 7))[::-1]
    both = [truth_of(POSES), replace(truth_of(other), scene_id=np.full(40, 2))]
    names = ("scene_id", "im_id", "obj_id", "gt_id", "cam_T_obj", "visib_fract")
    truth = GroundTruth(*(np.concatenate([getattr(t, n) for t in both]) for n in names))
    together = ObjectMotion.from_ground_truth(truth)
    assert together.scenes == {1, 2}
    for scene, alone in ((1, truth_of(POSES)), (2, truth_of(other))):
        motion = ObjectMotion.from_ground_truth(replace(alone, scene_id=np.full(40, scene)))
        found, wanted = (m.views_of(scene, 3, 2, [0, 1, 5]) for m in (together, motion))
        assert found.im_id.tolist() == wanted.im_id.tolist() == [0, 1, 5]
        np.testing.assert_array_equal(found.cam_T_view, wanted.cam_T_view)


@pytest.mark.parametrize(
    ("metres", "degrees", "serves"),
    [(0.0149, 0.0, True), (0.0151, 0.0, False), (0.0, 3.99, True), (0.0, 4.01, False)],
)
def test_objects_moved_together_within_15_mm_and_4_degrees(
    metres: float, degrees: float, serves: bool
) -> None:
    """The judged object is moved by itself, the others stand still."""
    poses = POSES.copy()
    turn = Rotation.from_rotvec([np.radians(degrees), 0, 0]).as_matrix()
    poses[1, 0, :3, :3] = poses[1, 0, :3, :3] @ turn
    poses[1, 0, 0, 3] += metres
    motion = ObjectMotion.from_ground_truth(truth_of(poses))
    assert (motion.views_of(1, 0, 1, [1]).im_id.tolist() == [1]) == serves


@pytest.mark.parametrize("objects_", [4, 6])
def test_the_covariance_is_as_large_as_the_errors_of_the_annotation(objects_: int) -> None:
    """Whatever is assumed of them: they say how well they agree."""
    chi, sizes = [], []
    for seed in range(30):
        world_T_obj = objects(objects_, seed)
        for scale in (1.0, 2.0):
            rng = np.random.default_rng(seed)
            poses = seen(CAMERAS[:2], world_T_obj)
            shape = poses.shape[:2]
            poses[..., :3, 3] += rng.normal(0, 0.0008 * scale, (*shape, 3))
            angles = rng.normal(0, 0.0004 * scale, (*shape, 3)).reshape(-1, 3)
            turn = Rotation.from_rotvec(angles).as_matrix().reshape(*shape, 3, 3)
            poses[..., :3, :3] = turn @ poses[..., :3, :3]
            found = ObjectMotion.from_ground_truth(truth_of(poses)).views_of(1, 0, 1, [1])
            assert found.refine is not None
            refined = found.refine(np.arange(1))
            assert refined.serves.tolist() == [True]
            sizes.append(np.trace(refined.covariance[0, :3, :3]))
            error = (true_motion(np.array([1])) @ invert(refined.cam_T_view))[0]
            twist = [*error[:3, 3], *Rotation.from_matrix(error[:3, :3]).as_rotvec()]
            chi.append(twist @ np.linalg.solve(refined.covariance[0], twist))
    assert np.divide(sizes[1::2], sizes[::2]) == pytest.approx(4.0, rel=0.05)
    # Translations and rotations are not wrong in the ratio that is assumed.
    assert 0.2 < np.median(chi) / 5.35 < 2.0


def test_estimates_never_claim_more_than_their_spreads() -> None:
    """Exact poses say nothing of how exact they are; with more objects the motion is surer."""
    sizes = []
    for n in (4, 7):
        poses = seen(CAMERAS[:2], objects(n))
        motion = ObjectMotion.from_estimates({"a": estimates_of(poses)}, dataset="d")
        found = motion.views_of(1, 0, 1, [1])
        assert found.refine is not None
        refined = found.refine(np.arange(1))
        np.testing.assert_allclose(refined.cam_T_view, found.cam_T_view, atol=1e-6)
        sizes.append(np.trace(refined.covariance[0, :3, :3]))
    # Of two images with a spread of 3 by 12 thousandths of 0.8 m, and 0.07 rad, each.
    cov = refined.covariance[0]
    cam, view = poses
    information = np.zeros((6, 6))
    for o in range(1, 7):
        total = np.zeros((3, 3))
        for pose, turn in ((cam[o], np.eye(3)), (view[o], found.cam_T_view[0, :3, :3])):
            far = np.linalg.norm(pose[:3, 3])
            ray = turn @ pose[:3, 3] / far
            total += (0.003 * far) ** 2 * np.eye(3)
            total += ((0.012 * far) ** 2 - (0.003 * far) ** 2) * np.outer(ray, ray)
        jacobian = np.hstack([np.eye(3), -skew(cam[o, :3, 3])])
        information += jacobian.T @ np.linalg.inv(total) @ jacobian
        information[3:, 3:] += np.eye(3) / (2 * 0.07**2)
    np.testing.assert_allclose(cov, np.linalg.inv(information), rtol=1e-4, atol=1e-9)
    assert sizes[1] < sizes[0]


def every(poses: ndarray) -> ObjectPoses:
    """Annotated poses, with what is assumed of them: a third of 15 mm and of 4 degrees."""
    shape = poses.shape[:2]
    return ObjectPoses(
        poses,
        np.ones(shape, bool),
        np.tile(0.005**2 * np.eye(3), (*shape, 1, 1)),
        np.full(shape, (np.radians(4.0) / 3) ** 2),
    )


def test_the_motion_is_the_fit_to_the_other_objects_scaled_by_how_well_they_agree() -> None:
    poses = scattered(POSES, 3, (0.001, 0.002, 0.004))
    found = ObjectMotion.from_ground_truth(truth_of(poses)).views_of(1, 0, 2, [1, 4])
    assert found.refine is not None
    refined = found.refine(np.arange(2))
    others = [0, 2, 3, 4]
    table = every(poses[:, others])
    start, there = found.cam_T_view, np.ones((2, 4), bool)
    fitted, covariance, distance = fit_motion(
        start, table.at(0), table.at(np.array([1, 4])), there, [np.eye(4)[None]] * 4
    )
    np.testing.assert_allclose(refined.cam_T_view, fitted, atol=1e-6)
    weight = 1 / (1 + distance / 6)
    scale = (weight * distance).sum(axis=1) / (6 * (weight.sum(axis=1) - 1))
    np.testing.assert_allclose(refined.covariance, covariance * scale[:, None, None], rtol=1e-4)


def test_estimates_that_disagree_widen_the_covariance() -> None:
    sizes = []
    for by in (0.2, 0.5, 3.0):
        errors = (0.003 * by, 0.012 * by, 0.02 * by)
        poses = seen(CAMERAS[:2], objects(7))
        motion = ObjectMotion.from_estimates(
            {"a": estimates_of(scattered(poses, 1, errors))}, dataset="d"
        )
        found = motion.views_of(1, 0, 1, [1])
        assert found.refine is not None
        sizes.append(float(np.trace(found.refine(np.arange(1)).covariance[0, 3:, 3:])))
    assert sizes[0] == pytest.approx(sizes[1], rel=0.3)
    assert sizes[2] > 1.3 * sizes[1]


@pytest.mark.parametrize("n", [1, 2])
def test_too_few_objects_have_no_motions_to_other_images(n: int) -> None:
    poses = POSES[:, :n]
    for motion in (
        ObjectMotion.from_ground_truth(truth_of(poses)),
        ObjectMotion.from_estimates({"a": estimates_of(poses)}, dataset="d"),
    ):
        found = motion.views_of(1, 0, 1, [1, 2])
        assert found.im_id.shape == (0,) and found.cam_T_view.shape == (0, 4, 4)
        assert found.noise.shape == (0, 2) and "fewer than two other objects" in found.why
