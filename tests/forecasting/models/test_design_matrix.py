"""The design matrix: features, pose errors and object numbers of each guiding estimator."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import synthetic
from graspcast.bop.models import Models
from graspcast.estimates.instances import scene_groups
from graspcast.forecasting.features import consensus_features
from graspcast.forecasting.models.design_matrix import DesignMatrix
from graspcast.forecasting.models.targets import Targets
from poses import random_poses, write_models


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Models]:
    half_turn = [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    folder = tmp_path_factory.mktemp("models")
    write_models(folder, obj_1={}, obj_2={"symmetries_discrete": [half_turn]})
    return {"d": Models(folder)}


def test_features_are_those_with_each_estimator_as_principal(models: dict[str, Models]) -> None:
    data = dataclasses.replace(synthetic.training_data(24), principal="b")
    matrix = DesignMatrix.of(data, Targets.of_objects(("d-1", "d-2")), models)
    for k, name in enumerate("abc"):
        expected = consensus_features(data.estimates, name, which="full", models=models)
        assert_array_equal(matrix.features[k], expected.values)
        if name == "b":
            assert matrix.names == expected.names
            assert_array_equal(matrix.own, expected.values)
    assert matrix.principal == 1
    assert_array_equal(matrix.success, data.success[None])
    assert_array_equal(matrix.groups, scene_groups(data.estimates.instances))
    assert matrix.is_tried.all()


def test_pose_errors_are_known_where_the_truth_is_up_to_symmetries(
    models: dict[str, Models],
) -> None:
    data = synthetic.training_data(24)
    truth = data.truth.copy()
    truth[3] = np.nan
    matrix = DesignMatrix.of(
        dataclasses.replace(data, truth=truth), Targets.of_objects(("d-1", "d-2")), models
    )
    error = np.linalg.inv(data.truth) @ data.estimates.cam_T_obj
    known = np.arange(24) != 3
    assert np.isnan(matrix.obj_T_est[:, 3, :3]).all()
    assert np.isnan(matrix.truth[:, 3]).all()
    assert_allclose(matrix.obj_T_est[:, known], error[:, known], atol=1e-9)
    # A half turn of the second object about z is not a pose error.
    half_turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    turned = np.where((data.objects == "d-2")[:, None, None], truth @ half_turn, truth)
    other = DesignMatrix.of(
        dataclasses.replace(data, truth=turned), Targets.of_objects(("d-1", "d-2")), models
    )
    expected = np.where(
        (data.objects == "d-2")[:, None, None], np.linalg.inv(half_turn) @ error @ half_turn, error
    )
    angle = np.arccos((np.trace(other.obj_T_est[:, known, :3, :3], axis1=2, axis2=3) - 1) / 2)
    original = np.arccos((np.trace(expected[:, known, :3, :3], axis1=2, axis2=3) - 1) / 2)
    assert_allclose(angle, original, atol=1e-6)


def test_other_objects_have_number_minus_one_and_their_simulated_trials_are_left_out(
    models: dict[str, Models],
) -> None:
    data = synthetic.training_data(24)
    trials = synthetic.error_outcomes(20, "d-2")
    trials = dataclasses.replace(trials, objects=np.where(np.arange(20) < 5, "d-1", "d-2"))
    data = dataclasses.replace(data, simulated=trials)
    matrix = DesignMatrix.of(data, Targets.of_objects(("d-2",)), models)
    assert_array_equal(matrix.numbers, np.where(data.objects == "d-2", 0, -1)[None])
    assert matrix.simulated is not None
    poses, numbers, success = matrix.simulated
    assert_array_equal(poses, trials.obj_T_est[5:])
    assert_array_equal(success, trials.success[5:])
    assert not numbers.any()


def test_stored_errors_are_used_instead_of_derived_ones(models: dict[str, Models]) -> None:
    """Of several true instances a campaign's matching may have taken another one."""
    data = synthetic.training_data(24)
    stored = np.full((3, 24, 4, 4), np.nan)
    stored[1, :10] = random_poses(10, 4)
    stored[1, :10, :3, :3] = np.eye(3)  # no symmetry turns it nearer
    matrix = DesignMatrix.of(
        dataclasses.replace(data, obj_T_est=stored), Targets.of_objects(("d-1", "d-2")), models
    )
    derived = DesignMatrix.of(data, Targets.of_objects(("d-1", "d-2")), models)
    assert_allclose(matrix.obj_T_est[1, :10], stored[1, :10], atol=1e-12)
    assert_array_equal(matrix.obj_T_est[1, 10:], derived.obj_T_est[1, 10:])
    assert_array_equal(matrix.obj_T_est[[0, 2]], derived.obj_T_est[[0, 2]])
    assert_array_equal(matrix.truth[[0, 2]], derived.truth[[0, 2]])
