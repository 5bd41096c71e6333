"""Scores of instances: found by key and pose, whatever alignment left out."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from graspcast.errors import MismatchError, UnknownNameError
from graspcast.estimates.alignment import align
from graspcast.estimates.scores import scores_of
from poses import nudged, random_poses, results_of


def scored(n: int = 6) -> tuple[dict, np.ndarray]:
    poses, score = random_poses(n), np.linspace(0.1, 0.9, n)
    a = dataclasses.replace(results_of(poses), score=score)
    b = dataclasses.replace(results_of(nudged(poses, 1)), score=1 - score)
    return {"a": a, "b": b}, score


def test_each_instance_has_the_score_of_its_row_whatever_the_order() -> None:
    tables, score = scored()
    estimates = align(tables, dataset="d")
    shuffled = tables["a"].select(np.random.default_rng(0).permutation(6))
    assert_array_equal(scores_of(estimates, "a", {"d": shuffled}), score)
    assert_array_equal(scores_of(estimates, "b", {"d": tables["b"]}), 1 - score)
    some = estimates.select(np.array([4, 1]))
    assert_array_equal(scores_of(some, "a", {"d": shuffled}), score[[4, 1]])


def test_a_row_left_out_for_its_pose_does_not_shift_the_others() -> None:
    poses = random_poses(3)
    bad = poses.copy()
    bad[0, 2, 3] = -1.0  # behind the camera, with the highest score
    one = np.zeros(3, np.int64)
    a = dataclasses.replace(results_of(bad), im_id=one, score=np.array([0.9, 0.5, 0.1]))
    b = dataclasses.replace(results_of(nudged(poses, 1)), im_id=one)
    estimates = align({"a": a, "b": b}, dataset="d")
    assert estimates.est_id.tolist() == [0, 1]
    assert scores_of(estimates, "a", {"d": a}).tolist() == [0.5, 0.1]


def test_a_dataset_without_results_has_no_scores() -> None:
    tables, _ = scored()
    assert np.isnan(scores_of(align(tables, dataset="d"), "a", {})).all()


def test_of_equal_poses_the_highest_score_counts() -> None:
    tables, score = scored(2)
    double = tables["a"].select(np.array([0, 1, 0]))
    double = dataclasses.replace(double, score=np.array([*score, 0.7]))
    assert scores_of(align(tables, dataset="d"), "a", {"d": double})[0] == 0.7


def test_other_results_are_refused() -> None:
    tables, _ = scored()
    estimates = align(tables, dataset="d")
    with pytest.raises(MismatchError, match=r"no estimate with the pose by a of d-1 in image"):
        scores_of(estimates, "a", {"d": tables["b"]})
    with pytest.raises(UnknownNameError, match="c"):
        scores_of(estimates, "c", {"d": tables["a"]})
