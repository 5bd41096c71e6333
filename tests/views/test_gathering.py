"""Gathering of estimates from the views of a scene."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from graspcast.bop.results import Results
from graspcast.pose.transforms import compose, invert
from graspcast.views.camera_motion import CameraMotion, CameraNoise
from graspcast.views.gathering import Gathered, ViewRules, gather
from graspcast.views.spread import Spreads
from static_scenes import estimates_of, motion_of, objects, orbit, scattered, seen

CAMERAS = orbit(8)
POSES = seen(CAMERAS, objects(2))


def gathered(results: Mapping[str, Results], motion: CameraMotion | None, **rules: Any) -> Gathered:
    given = {"views_from": "all", "max_views": 3, "min_parallax_rad": np.deg2rad(12)} | rules
    return gather(results, motion, "d", "a", Spreads(), {}, ViewRules(noise=CameraNoise(), **given))


def test_views_are_other_images_of_the_scene() -> None:
    results = {"a": estimates_of(POSES), "b": estimates_of(scattered(POSES, 1))}
    found = gathered(results, motion_of(CAMERAS))
    assert found.present.shape == (16, 3, 2) and found.present.all()
    assert (found.view_im_id[:, 0] == found.instances.im_id).all()
    np.testing.assert_array_equal(found.score[:, 0], results["a"].score)  # in this order already
    assert (found.view_im_id[:, 1:] != found.instances.im_id[:, None]).all()
    carried = found.cam_T_view[:, :, None] @ found.view_T_obj
    np.testing.assert_allclose(carried[:, 1:, 0], carried[:, :1, 0].repeat(2, 1), atol=1e-9)


def test_earlier_images_alone() -> None:
    found = gathered({"a": estimates_of(POSES)}, motion_of(CAMERAS), views_from="earlier")
    there = found.view_im_id >= 0
    assert (np.where(there, found.view_im_id, -1)[:, 1:] < found.instances.im_id[:, None]).all()
    assert found.present[found.instances.im_id == 0].sum() == 2
    assert found.single == {
        "have no earlier image with an estimate of the object": 2,
        "have no earlier image from another direction (parallax too small)": 2,
    }


def test_why_there_is_one_view_is_counted() -> None:
    results = {"a": estimates_of(POSES)}
    some = CameraMotion({k: v for k, v in motion_of(CAMERAS).world_T_cam.items() if k[1] > 1})
    assert gathered(results, some).single == {"have no camera pose": 4}
    same = motion_of(np.repeat(CAMERAS[:1], 8, axis=0))
    assert gathered(results, same).single == {
        "have no other image from another direction (parallax too small)": 16
    }
    assert gathered(results, None, max_views=1).single == {}
    assert gathered(results, motion_of(CAMERAS), max_views=1).present.shape == (16, 1, 1)


def test_a_view_by_one_of_two_estimators_serves() -> None:
    b = estimates_of(POSES)
    results = {"a": estimates_of(POSES), "b": b.select(b.im_id != 4)}
    found = gathered(results, motion_of(CAMERAS))
    i = int(np.flatnonzero((found.instances.im_id == 4) & (found.instances.obj_id == 1))[0])
    assert found.present[i].tolist() == [[True, False], [True, True], [True, True]]


def test_instances_of_one_object_keep_their_own_views() -> None:
    results = {"a": estimates_of(scattered(POSES, 2), obj_ids=[1, 1])}
    found = gathered(results, motion_of(CAMERAS))
    assert found.present.all() and not found.doubtful.any()
    carried = (found.cam_T_view[:, :, None] @ found.view_T_obj)[:, :, 0, :3, 3]
    assert np.linalg.norm(carried - carried[:, :1], axis=-1).max() < 0.07


def test_views_in_doubt_are_left_out_and_counted() -> None:
    near = objects(2)
    near[1] = near[0]
    near[1, :3, 3] += [0.006, 0.0, 0.0]
    poses = scattered(seen(CAMERAS, near), 3)
    found = gathered({"a": estimates_of(poses, obj_ids=[1, 1])}, motion_of(CAMERAS))
    assert found.doubtful.sum() > 16
    assert any("not sure which of several" in line for line in found.single_views())


def test_everything_that_is_gathered_is_of_its_image_and_instance() -> None:
    """Two instances of an object, which every estimator found in another order of scores."""
    rng = np.random.default_rng(0)
    results = {}
    for k, name in enumerate("abc"):
        table = estimates_of(scattered(POSES, k), obj_ids=[1, 1])
        columns = dict(vars(table)) | {"score": rng.permutation(len(table)) / len(table)}
        rows = rng.random(len(table)) < (1.0 if name == "a" else 0.7)
        results[name] = Results(**columns).select(rows)
    found = gathered(results, motion_of(CAMERAS))
    assert not found.present.all() and found.present[:, 1:].any(axis=(0, 1)).all()
    for i, (_, scene_id, im_id, obj_id, number) in enumerate(found.instances.to_keys()):
        assert found.view_im_id[i, 0] == im_id
        assert found.est_id[i, 0] == number
        for k, table in enumerate(results.values()):
            for v in range(3):
                if not found.present[i, v, k]:
                    assert v or (found.est_id[i, k], np.isnan(found.score[i, k])) == (-1, True)
                    continue
                image = found.view_im_id[i, v]
                mine = (table.scene_id == scene_id) & (table.im_id == image)
                mine &= table.obj_id == obj_id
                pose = found.view_T_obj[i, v, k]
                (row,) = np.flatnonzero(mine & (table.cam_T_obj == pose).all(axis=(1, 2)))
                if v == 0:
                    assert found.score[i, k] == table.score[row]
                    rank = (table.score[mine] > table.score[row]).sum()
                    assert found.est_id[i, k] == rank
                # All are near the same place.
                true = found.cam_T_view[i, v] @ pose
                assert np.linalg.norm((true - found.view_T_obj[i, 0, 0])[:3, 3]) < 0.06
    absent = ~found.present.any(axis=2)
    assert (found.view_im_id[absent] == -1).all()
    np.testing.assert_array_equal(
        found.cam_T_view[absent], np.tile(np.eye(4), (absent.sum(), 1, 1))
    )
    own = compose(invert(CAMERAS[found.instances.im_id])[:, None], CAMERAS[found.view_im_id])
    np.testing.assert_allclose(found.cam_T_view[~absent], own[~absent], atol=1e-9)


def test_what_is_said_of_one_and_of_several() -> None:
    found = gathered({"a": estimates_of(POSES)}, motion_of(CAMERAS[:7]))
    assert found.single_views()[0] == "single views: 2 instances have no camera pose"
    found = gathered({"a": estimates_of(POSES[:, :1])}, motion_of(CAMERAS[:7]))
    assert found.single_views()[0] == "single views: 1 instance has no camera pose"


def test_progress_is_the_share_of_objects_in_images() -> None:
    shares, said = [], []

    def progress(share: float, message: object) -> None:
        shares.append(share)
        said.append(message)

    rules = ViewRules("all", 3, np.deg2rad(12), CameraNoise())
    gather({"a": estimates_of(POSES)}, motion_of(CAMERAS), "d", "a", Spreads(), {}, rules, progress)
    assert shares == [i / 16 for i in range(16)]
    assert [(c.done, c.total) for c in said] == [(i, 16) for i in range(16)]
