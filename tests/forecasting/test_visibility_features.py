"""Columns of a visibility model: what each is, and what is not known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose

from graspcast.errors import InputError
from graspcast.estimates.alignment import align
from graspcast.forecasting.features import Features
from graspcast.forecasting.visibility_features import (
    POSE_COLUMNS,
    SCORE_COLUMN,
    features_of_one,
    median_row,
    seen_of,
    visibility_features,
)
from graspcast.pose.transforms import rotation_from_vector, transform
from poses import random_poses, results_of


def test_the_columns_say_from_where_the_object_is_seen() -> None:
    quarter = rotation_from_vector(np.array([0.0, np.pi / 2, 0.0]))
    pose = transform(quarter, np.array([0.0, 0.3, 0.4]))
    found = visibility_features(pose[None], np.array([0.8]))
    named = dict(zip(found.names, found.values[0].tolist(), strict=True))
    assert_allclose([named["distance"], named["image_x"], named["image_y"]], [0.5, 0, 0.6])
    # Camera to object is (0, .6, .8); the object's x is the camera's -z, y its y, z its x.
    assert_allclose([named[f"view_{axis}"] for axis in "xyz"], [0.8, -0.6, 0], atol=1e-12)
    assert named[SCORE_COLUMN] == 0.8


def test_the_viewing_direction_does_not_change_with_the_camera_s_roll() -> None:
    poses = random_poses(5)
    roll = transform(rotation_from_vector(np.array([0.0, 0.0, 1.0])), np.zeros(3))
    a, b = visibility_features(poses).values, visibility_features(roll @ poses).values
    assert_allclose(a[:, :4], b[:, :4], atol=1e-12)
    assert_allclose(np.linalg.norm(a[:, :3], axis=1), 1)


def test_what_is_not_known_is_nan_and_image_fit_comes_last() -> None:
    poses = random_poses(3)
    assert visibility_features(poses).names == (*POSE_COLUMNS, SCORE_COLUMN)
    assert np.isnan(visibility_features(poses).values[:, -1]).all()
    fit = Features(("f", "g"), np.arange(6.0).reshape(3, 2))
    found = visibility_features(poses, fit=fit)
    assert found.names[-2:] == ("f", "g")
    assert_allclose(found.values[:, -2:], fit.values)


def test_medians_are_finite() -> None:
    values = np.array([[1.0, np.nan, np.nan], [3.0, 5.0, np.nan]])
    assert median_row(values).tolist() == [2.0, 5.0, 0.0]


def test_the_columns_of_an_estimator_are_those_that_are_known_of_it() -> None:
    poses = random_poses(3)
    given = align({"a": results_of(poses)}, dataset="d")
    expected = visibility_features(poses, np.array([1, 0.5, 0]))
    assert_allclose(features_of_one(given).values, expected.values)
    fit = np.arange(3.0)[None]
    more = dataclasses.replace(given, seen={**given.seen, "f": fit})
    assert features_of_one(more).names[-1] == "f"
    # A model that knows a further column, and one that knows none.
    asked = features_of_one(more, (*POSE_COLUMNS, SCORE_COLUMN, "f", "g"))
    assert asked.names[-2:] == ("f", "g")
    assert_allclose(asked.values[:, -2], fit[0])
    assert np.isnan(asked.values[:, -1]).all()
    assert features_of_one(more, (*POSE_COLUMNS, SCORE_COLUMN)).values.shape == (3, 7)
    assert features_of_one(given, (*POSE_COLUMNS, SCORE_COLUMN, "f")).values.shape == (3, 7)


def test_what_is_known_of_one_estimate_is_checked() -> None:
    assert seen_of(None, None) == {}
    assert seen_of(0.5, None)["score"].tolist() == [[0.5]]
    fit = Features(("f", "g"), np.array([[1.0, 2.0]]))
    assert {k: v.tolist() for k, v in seen_of(None, fit).items()} == {"f": [[1.0]], "g": [[2.0]]}
    with pytest.raises(InputError, match="score"):
        seen_of(float("nan"), None)
    with pytest.raises(InputError, match="image fit is of 2 instances"):
        seen_of(None, Features(("f",), np.zeros((2, 1))))
