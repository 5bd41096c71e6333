"""Columns of a visibility model: what each is, and what is not known."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from graspcast.forecasting.features import Features
from graspcast.forecasting.visibility_features import (
    POSE_COLUMNS,
    SCORE_COLUMN,
    typical_row,
    visibility_features,
)
from graspcast.pose.transforms import rotation_from_vector, transform
from poses import random_poses


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


def test_the_typical_row_is_finite() -> None:
    values = np.array([[1.0, np.nan, np.nan], [3.0, 5.0, np.nan]])
    assert typical_row(Features(("a", "b", "c"), values)).tolist() == [2.0, 5.0, 0.0]
