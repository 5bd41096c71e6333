"""Transferred errors: those of other objects, never the object's own, whatever their symmetries."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results
from graspcast.bop.units import millimetres
from graspcast.errors import InputError, MismatchError
from graspcast.pose.transforms import rotation_angle
from graspcast.simulation.campaign.pose_errors import PoseErrors
from graspcast.simulation.campaign.requests import TrialRequests
from graspcast.simulation.campaign.transferred_errors import (
    TRANSFERRED,
    trials_from_transferred_errors,
)
from graspcast.simulation.objects.types import Grasp
from poses import nudged, random_poses, results_of, write_models

N, OBJECTS = 45, 3
HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])


def number_of() -> np.ndarray:
    return np.arange(N) % OBJECTS + 1


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> BopDataset:
    """Three objects, the second with a half turn; one instance an image."""
    root = tmp_path_factory.mktemp("made")
    half = {"symmetries_discrete": [HALF_TURN.ravel().tolist()]}
    write_models(root / "models", obj_1={}, obj_2=half, obj_3={})
    camera = {"fx": 570.0, "fy": 570.0, "cx": 320.0, "cy": 240.0}
    (root / "camera.json").write_text(json.dumps(camera))
    folder = root / "test" / "000001"
    folder.mkdir(parents=True)
    images = {
        str(i): [
            {
                "obj_id": int(number),
                "cam_R_m2c": pose[:3, :3].ravel().tolist(),
                "cam_t_m2c": millimetres(pose[:3, 3]).tolist(),
            }
        ]
        for i, (number, pose) in enumerate(zip(number_of(), random_poses(N), strict=True))
    }
    (folder / "scene_gt.json").write_text(json.dumps(images))
    return BopDataset(root, name="made")


def results(*, turned: int = 0, spoilt: int | None = None) -> Results:
    """Small errors; half turns of one object; one estimate that is half a metre off."""
    poses = nudged(random_poses(N), 1, metres=0.002, radians=0.02)
    mine = number_of() == turned
    poses[mine] = poses[mine] @ HALF_TURN
    if spoilt is not None:
        poses[spoilt, 0, 3] += 0.5
    return dataclasses.replace(results_of(poses), obj_id=number_of())


def grasp_of(name: str, grasp: str = "reference") -> Grasp:
    return Grasp(np.eye(4), name, "parallel", grasp)


def transferred_errors(
    dataset: BopDataset, table: Results, *objects: int, **options: int
) -> TrialRequests:
    grasps = [grasp_of(f"made-{number}") for number in objects]
    options = {"count": 300} | options
    errors = PoseErrors.of_estimates({"made": {"a": table}}, {"made": dataset})
    return trials_from_transferred_errors(errors, grasps, **options)


def offsets(requests: TrialRequests, number: int) -> np.ndarray:
    mine = (requests.keys["obj_id"] == number).to_numpy()
    return np.asarray(np.linalg.norm(requests.obj_T_est[mine, :3, 3], axis=1))


def angles(requests: TrialRequests, number: int) -> np.ndarray:
    mine = (requests.keys["obj_id"] == number).to_numpy()
    return rotation_angle(requests.obj_T_est[mine, :3, :3])


@pytest.mark.parametrize("owner", [1, 2, 3])
def test_no_error_of_the_object_itself_is_used(dataset: BopDataset, owner: int) -> None:
    spoilt = int(np.flatnonzero(number_of() == owner)[4])
    requests = transferred_errors(dataset, results(spoilt=spoilt), 1, 2, 3)
    for number in (1, 2, 3):
        largest = offsets(requests, number).max()
        if number == owner:
            assert largest < 0.05
        else:
            assert largest == pytest.approx(0.5, abs=0.03)


def test_an_error_keeps_its_size_and_the_side_is_random(dataset: BopDataset) -> None:
    table = results()
    requests = transferred_errors(dataset, table, 1, count=2000)
    true = random_poses(N)
    error = np.linalg.inv(true) @ table.cam_T_obj
    others = number_of() != 1
    for mine, theirs in (
        (offsets(requests, 1), np.linalg.norm(error[others, :3, 3], axis=1)),
        (angles(requests, 1), rotation_angle(error[others, :3, :3])),
    ):
        # Each size is that of one of the donors' errors, and every donor is used.
        nearest = np.abs(mine[:, None] - theirs).min(axis=1)
        assert nearest.max() < 1e-6
        assert np.abs(mine[:, None] - theirs).min(axis=0).max() < 1e-6
    position = requests.obj_T_est[:, :3, 3]
    direction = position / np.linalg.norm(position, axis=1, keepdims=True)
    assert np.linalg.norm(direction.mean(axis=0)) < 0.1
    assert_allclose(direction.T @ direction / len(direction), np.eye(3) / 3, atol=0.05)


def test_a_turn_by_a_donors_symmetry_is_no_error(dataset: BopDataset) -> None:
    symmetric = transferred_errors(dataset, results(turned=2), 1, 3)
    assert angles(symmetric, 1).max() < 0.2
    assert angles(symmetric, 3).max() < 0.2
    # but the same turn of an object without it is
    wrong = transferred_errors(dataset, results(turned=3), 1, 3)
    assert angles(wrong, 1).max() > 3
    assert angles(wrong, 3).max() < 0.2


def test_seeds_and_other_pairs(dataset: BopDataset) -> None:
    table = results()
    one = transferred_errors(dataset, table, 1, 2)
    assert_array_equal(transferred_errors(dataset, table, 1, 2).obj_T_est, one.obj_T_est)
    assert (transferred_errors(dataset, table, 1, 2, seed=1).obj_T_est != one.obj_T_est).any()
    # What else is asked for changes nothing.
    both = transferred_errors(dataset, table, 2, 3, 1)
    for number in (1, 2):
        first, second = ((r.keys["obj_id"] == number).to_numpy() for r in (one, both))
        assert_array_equal(both.obj_T_est[second], one.obj_T_est[first])
    assert (one.obj_T_est[:300] != one.obj_T_est[300:]).any()
    keys = one.keys
    assert set(keys["estimator"]) == {TRANSFERRED}
    assert keys["object"].unique().sort().to_list() == ["made-1", "made-2"]
    assert keys.filter(obj_id=1)["im_id"].to_list() == list(range(300))


def test_errors_of_all_objects_are_transferred_to_a_new_one(dataset: BopDataset) -> None:
    errors = PoseErrors.of_estimates({"made": {"a": results()}}, {"made": dataset})
    found = trials_from_transferred_errors(errors, [grasp_of("mine-7")], count=50)
    assert len(found.keys) == 50
    assert found.keys["dataset"].unique().to_list() == ["mine"]


def test_all_grasps_of_an_object_are_tried_with_the_same_errors(dataset: BopDataset) -> None:
    grasps = [grasp_of("mine-7", "top"), grasp_of("mine-7", "side"), grasp_of("mine-8")]
    errors = PoseErrors.of_estimates({"made": {"a": results()}}, {"made": dataset})
    found = trials_from_transferred_errors(errors, grasps, count=50)
    top, side, other = (found.obj_T_est[found.rows_of(g.object, g.gripper, g.name)] for g in grasps)
    assert np.array_equal(top, side)
    assert not np.array_equal(top, other)


def test_what_is_refused_and_what_is_no_estimate(dataset: BopDataset) -> None:
    table = results()
    with pytest.raises(InputError, match="count is 0; give at least 1"):
        transferred_errors(dataset, table, 1, count=0)
    with pytest.raises(InputError, match="'mug' has no number"):
        errors = PoseErrors.of_estimates({"made": {"a": table}}, {"made": dataset})
        trials_from_transferred_errors(errors, [grasp_of("mug")], count=1)
    with pytest.raises(InputError, match="1,000,000,000 trials of each of 1 grasp are too many"):
        transferred_errors(dataset, table, 1, count=10**9)
    only = table.select(table.obj_id == 2)
    with pytest.raises(MismatchError, match="no errors to transfer to made-2"):
        transferred_errors(dataset, only, 2)
    assert len(transferred_errors(dataset, only, 1).keys) == 300
    # A placeholder at the camera's centre is no estimate.
    nothing = table.cam_T_obj.copy()
    nothing[0] = np.eye(4)
    holed = dataclasses.replace(table, cam_T_obj=nothing)
    assert offsets(transferred_errors(dataset, holed, 2, count=1000), 2).max() < 0.05
