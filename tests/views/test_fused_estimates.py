"""Fused estimates of whole results."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import read_results, write_results
from graspcast.errors import GraspcastError, InputError, MismatchError
from graspcast.estimates.instances import KEY_COLUMNS
from graspcast.estimates.matching import match
from graspcast.pose.transforms import rotation_from_vector, transform
from graspcast.views.camera_motion import CameraMotion, CameraNoise
from graspcast.views.camera_tables import read_camera_motion
from graspcast.views.fused_estimates import FusedEstimates, fuse_estimates
from graspcast.views.spread import learn_spreads
from static_scenes import estimates_of, motion_of, objects, orbit, scattered, seen
from test_misuse import ODD

CAMERAS = orbit(10)
POSES = seen(CAMERAS, objects(3))
RESULTS = {name: estimates_of(scattered(POSES, seed)) for seed, name in enumerate("abc")}


def fused(results: Any = None, motion: Any = None, **given: Any) -> FusedEstimates:
    given = {"dataset": "d", "views_from": "all"} | given
    return fuse_estimates(results or RESULTS, motion or motion_of(CAMERAS), **given)


def position_errors(found: FusedEstimates) -> np.ndarray:
    keys = found.instances
    true = POSES[keys.im_id, keys.obj_id - 1]
    return np.asarray(np.linalg.norm(found.poses.cam_T_obj[:, :3, 3] - true[:, :3, 3], axis=1))


def test_more_views_and_estimators_are_better() -> None:
    one = fused({"a": RESULTS["a"]}, max_views=1)
    assert np.array_equal(one.poses.cam_T_obj, one.gathered.view_T_obj[:, 0, 0]) or np.allclose(
        one.poses.cam_T_obj, one.gathered.view_T_obj[:, 0, 0], atol=1e-9
    )
    three = fused({"a": RESULTS["a"]})
    everyone = fused()
    sizes = [np.median(position_errors(found)) for found in (one, three, everyone)]
    assert sizes[0] > 1.8 * sizes[1] > 1.8 * sizes[2]
    assert (everyone.score > one.score).all()
    assert repr(everyone).startswith("FusedEstimates(a, b, c; Instances(30 of 3 objects")


def test_the_world_frame_makes_no_difference() -> None:
    turn = transform(rotation_from_vector(np.array([0.3, -1.0, 2.0])), np.array([3.0, -2.0, 1.0]))
    other = fused(motion=motion_of(turn @ CAMERAS))
    np.testing.assert_allclose(other.poses.cam_T_obj, fused().poses.cam_T_obj, atol=1e-6)


def test_the_order_of_estimators_and_rows_makes_no_difference() -> None:
    rng = np.random.default_rng(0)
    mixed = {n: RESULTS[n].select(rng.permutation(len(RESULTS[n]))) for n in "cab"}
    other, mine = fused(mixed, principal="a"), fused(principal="a")
    np.testing.assert_allclose(other.poses.cam_T_obj, mine.poses.cam_T_obj, atol=1e-6)
    assert mine.instances.to_keys() == other.instances.to_keys()


def test_results_and_table_belong_together(tmp_path: Path) -> None:
    found = fused()
    write_results(tmp_path / "f.csv", found.results)
    back = read_results(tmp_path / "f.csv")
    np.testing.assert_allclose(back.cam_T_obj, found.poses.cam_T_obj, rtol=0, atol=1e-14)
    table = found.table()
    assert table.columns[:6] == [*KEY_COLUMNS, "principal_est_id"]
    assert len(table) == 30 and (table["views"] == 3).all() and (table["estimates"] == 9).all()
    sd = np.sqrt(np.maximum(sum(table[f"cov_cam_{i}{i}"] for i in range(3)), 0))
    np.testing.assert_allclose(table["score"], 1 / (1 + sd / 0.01))
    trace = sum(table[f"cov_obj_{i}{i}"] for i in range(3))
    np.testing.assert_allclose(np.sqrt(trace), sd)
    assert found.summary() == ["30 instances: 30 from 3 views"]


def test_a_moved_object_is_dropped_and_said() -> None:
    moved = {}
    for name, table in RESULTS.items():
        poses = table.cam_T_obj.reshape(POSES.shape).copy()
        poses[:5, 0, :3, 3] += [0.2, 0.0, 0.0]
        moved[name] = estimates_of(poses)
    found = fused(moved, max_views=4)
    assert found.poses.dropped[found.instances.obj_id == 1].any()
    assert any("views that contradict the others" in line for line in found.summary())
    assert any("own_image_dropped" in line for line in found.summary())
    assert found.table()["own_image_dropped"].sum() == (~found.poses.used[:, 0].any(axis=1)).sum()


def test_noise_widens_the_covariance() -> None:
    wide = fused(noise=CameraNoise(0.01, 0.01))
    assert (wide.poses.across_m > fused().poses.across_m).all()


def test_no_motion_and_other_scenes() -> None:
    alone = fuse_estimates(RESULTS, None, dataset="d")
    assert (alone.views == 1).all()
    with pytest.raises(MismatchError, match=r"of other scenes \(4 …\) than the estimates \(1 …\)"):
        fused(motion=motion_of(CAMERAS, scene_id=4))
    with pytest.raises(MismatchError, match="in millimetres instead of metres"):
        big = CAMERAS.copy()
        big[:, :3, 3] *= 1e3
        fused(motion=motion_of(big))


@pytest.mark.ill_typed
@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"principal": "z"}, "unknown estimator 'z'"),
        ({"views_from": "later"}, "views_from should be"),
        ({"max_views": 0}, "max_views should be a number from 1"),
        ({"max_views": 2.5}, "whole number"),
        ({"min_parallax_rad": -1.0}, "min_parallax_rad should be"),
        ({"noise": "1mm"}, "noise should be"),
        ({"motion": "x"}, "motion should be"),
        ({"results": "x"}, "results should be"),
        ({"models": {"d": 1}}, "models should be"),
    ],
)
def test_wrong_arguments_are_refused(given: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        fused(**given)
    with pytest.raises(InputError, match="there are no estimates to fuse"):
        fuse_estimates({}, None, dataset="d")


@pytest.mark.ill_typed
@pytest.mark.parametrize("odd", ODD, ids=range(len(ODD)))
def test_whatever_is_given_the_answer_is_a_result_or_an_error(odd: Any) -> None:
    motion = motion_of(CAMERAS)
    given = {"results": RESULTS, "motion": motion, "dataset": "d", "principal": "a"}
    given |= dict.fromkeys(("models", "noise", "spreads", "max_views", "views_from"))
    given |= {"max_views": 2, "views_from": "all", "min_parallax_rad": 0.2}
    calls: list[Callable[[], Any]] = [
        *(partial(fuse_estimates, **{**given, name: odd}) for name in given),
        partial(CameraMotion, odd),
        partial(CameraMotion, {(1, 1): odd}),
        partial(CameraMotion.of, odd, [1], CAMERAS[:1]),
        partial(CameraMotion.of, [1], [odd], CAMERAS[:1]),
        partial(CameraMotion.of, [1], [1], odd),
        partial(motion.between, odd, 0, 1),
        partial(CameraNoise, odd),
        partial(CameraNoise.parse, odd),
        partial(read_camera_motion, odd),
        partial(learn_spreads, odd, odd),
    ]
    for call in calls:
        with suppress(GraspcastError):
            call()


def test_nothing_to_fuse() -> None:
    empty = RESULTS["a"].select(np.zeros(30, bool))
    with pytest.raises(InputError, match="a has no estimate to fuse"):
        fused({"a": empty, "b": RESULTS["b"]})
    assert len(fused({"a": RESULTS["a"], "b": empty})) == 30


def test_copies_and_other_conventions_are_refused() -> None:
    with pytest.raises(InputError, match="b has the same pose as a in each of 30 instances"):
        fused({"a": RESULTS["a"], "b": RESULTS["a"]})
    poses = RESULTS["b"].cam_T_obj.copy()
    poses[:, :3, :3] = np.swapaxes(poses[:, :3, :3], 1, 2)
    with pytest.raises(MismatchError, match="b"):
        fused(RESULTS | {"b": replace(RESULTS["b"], cam_T_obj=poses)})


def test_images_without_a_camera_pose_are_single_views_and_said() -> None:
    some = {key: pose for key, pose in motion_of(CAMERAS).world_T_cam.items() if key[1] != 3}
    found = fused(motion=CameraMotion(some))
    assert (found.views[found.instances.im_id == 3] == 1).all()
    assert "single views: 3 instances have no camera pose" in found.summary()


@pytest.mark.slow
def test_published_estimates(published: Path) -> None:
    """YCB-V: fused poses of three views are twice as accurate as the best estimator's."""
    root = published / "ycbv"
    names = ("zebrapose", "gdrnpp", "epos")
    tables = {n: read_results(root / f"{n}_ycbv-test.csv") for n in names}
    dataset = BopDataset(published.parent / "bop" / "ycbv", ground_truth=root / "ground_truth")
    known = list(dataset.models.info)
    tables = {n: t.select(np.isin(t.obj_id, known)) for n, t in tables.items()}
    models = {"ycbv": dataset.models}
    motion = read_camera_motion(root / "camera_motion")
    found = fuse_estimates(tables, motion, dataset="ycbv", models=models, views_from="all")

    def median_error(results: Any) -> float:
        row = match(results, dataset.ground_truth)
        true = dataset.ground_truth.cam_T_obj[row][row >= 0]
        offset = results.cam_T_obj[row >= 0][:, :3, 3] - true[:, :3, 3]
        return float(np.median(np.linalg.norm(offset, axis=1)))

    assert median_error(found.results) < 0.5 * min(map(median_error, tables.values()))
    inverted = {key: np.linalg.inv(pose) for key, pose in motion.world_T_cam.items()}
    with pytest.raises(GraspcastError, match="read in the other direction"):
        fuse_estimates(tables, CameraMotion(inverted), dataset="ycbv", models=models)


def test_fused_results_have_no_time() -> None:
    """-1 is BOP's value for a time that is not known."""
    found = fuse_estimates({"a": estimates_of(scattered(POSES, 1))}, None, dataset="d")
    assert (found.results.time_s == -1.0).all()


def test_the_summary_counts_instances_by_views() -> None:
    found = fuse_estimates({"a": estimates_of(POSES)}, motion_of(CAMERAS), dataset="d")
    numbers = sorted(set(found.views.tolist()))
    assert numbers == [1, 2, 3]
    counts = [f"{(found.views == v).sum()} from {v} view{'s' * (v > 1)}" for v in numbers]
    assert ", ".join(counts) in "\n".join(found.summary())


@pytest.mark.parametrize("degrees", [0.0, 10.0, 180.0])
def test_the_least_parallax_is_an_angle(degrees: float) -> None:
    given = {"a": estimates_of(POSES)}
    found = fuse_estimates(
        given, motion_of(CAMERAS), dataset="d", min_parallax_rad=np.deg2rad(degrees)
    )
    assert ((found.views > 1).any()) == (degrees < 180)
    for wrong in (-0.1, 3.2, float("nan")):
        with pytest.raises(InputError, match="min_parallax_rad"):
            fuse_estimates(given, motion_of(CAMERAS), dataset="d", min_parallax_rad=wrong)
