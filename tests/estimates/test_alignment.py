"""K estimators side by side: which detection is which instance."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from graspcast.bop.results import Results
from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.alignment import align, concatenate, estimate_ids
from poses import nudged, random_poses, results_of


def detections(
    positions: list[tuple[float, float, float]], scores: list[float], im_id: int = 0
) -> Results:
    """Several detections of object 1 in one image."""
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :3, 3] = positions
    table = results_of(poses)
    return dataclasses.replace(
        table, im_id=np.full(len(positions), im_id), score=np.array(scores, dtype=float)
    )


def test_rows_are_paired_by_image_and_object_whatever_their_order() -> None:
    poses = random_poses(10)
    other = results_of(nudged(poses, 1))
    shuffled = np.random.default_rng(0).permutation(10)
    other = other.select(shuffled)
    both = align({"a": results_of(poses), "b": other}, dataset="d")
    assert_array_equal(both.of("a"), poses)
    assert_array_equal(both.of("b"), nudged(poses, 1))
    assert both.lacking == {"a": 0, "b": 0}
    assert both.supporters("b") == ("a",)
    assert set(both.objects) == {"d-1"}


def test_what_one_estimator_lacks_is_dropped_and_counted() -> None:
    a = results_of(random_poses(5))
    b = dataclasses.replace(results_of(random_poses(5)), im_id=np.array([0, 1, 2, 7, 8]))
    both = align({"a": a, "b": b}, dataset="d")
    assert both.im_id.tolist() == [0, 1, 2]
    assert both.lacking == {"a": 2, "b": 2}


def test_instances_are_numbered_by_the_anchors_score_and_paired_by_position() -> None:
    a = detections([(0, 0, 1), (0.5, 0, 1), (0, 0.5, 1)], [0.1, 0.9, 0.5])
    b = detections([(0.01, 0.5, 1), (0.01, 0, 1), (0.51, 0, 1)], [0.9, 0.8, 0.7])
    both = align({"a": a, "b": b}, dataset="d", anchor="a")
    assert both.est_id.tolist() == [0, 1, 2]
    assert both.of("a")[:, 0, 3].tolist() == [0.5, 0, 0]
    assert both.of("b")[:, 0, 3].tolist() == [0.51, 0.01, 0.01]
    assert estimate_ids(a).tolist() == [2, 0, 1]


def test_pairing_minimises_the_total_not_each_distance() -> None:
    # Greedy pairing would give b's 0.0 to a's 0.1 and leave 1.0 for 0.0.
    a = detections([(0.1, 0, 1), (-0.5, 0, 1)], [0.9, 0.8])
    b = detections([(0.0, 0, 1), (1.0, 0, 1)], [0.9, 0.8])
    both = align({"a": a, "b": b}, dataset="d")
    assert both.of("b")[:, 0, 3].tolist() == [1.0, 0.0]


def test_surplus_detections_are_dropped() -> None:
    a = detections([(0, 0, 1), (0.5, 0, 1)], [0.9, 0.8])
    b = detections([(0.5, 0, 1)], [0.9])
    both = align({"a": a, "b": b}, dataset="d")
    assert both.of("a")[:, 0, 3].tolist() == [0.5]
    assert both.est_id.tolist() == [1]
    assert both.lacking == {"a": 0, "b": 1}
    # With the other as anchor the same pair is its instance 0.
    assert align({"a": a, "b": b}, dataset="d", anchor="b").est_id.tolist() == [0]


@given(st.permutations(range(4)), st.integers(0, 100))
def test_the_anchors_order_of_rows_does_not_matter(order: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    where = [tuple(p) for p in rng.normal(size=(4, 3)).tolist()]
    scores = [0.9, 0.8, 0.7, 0.6]
    a = detections(where, scores)
    b = detections([where[i] for i in order], [scores[i] for i in order])
    both = align({"a": a, "b": b}, dataset="d")
    assert_array_equal(both.of("a"), both.of("b"))


def test_messages_list_what_there_is() -> None:
    a = results_of(random_poses(2))
    with pytest.raises(InputError, match="takes at least two estimators, but there is 1"):
        align({"a": a}, dataset="d")
    with pytest.raises(UnknownNameError, match="unknown estimator 'c'; known: a, b"):
        align({"a": a, "b": a}, dataset="d", anchor="c")
    with pytest.raises(UnknownNameError, match=r"'gdrnp' \(did you mean 'gdrnpp'\?\)"):
        align({"epos": a, "gdrnpp": a}, dataset="d").of("gdrnp")
    elsewhere = dataclasses.replace(a, scene_id=a.scene_id + 1)
    with pytest.raises(MismatchError, match=r"no instance of d has a pose by every .* \(a: 2 rows"):
        align({"a": a, "b": elsewhere}, dataset="d")


def test_datasets_are_put_one_after_the_other() -> None:
    a, b = results_of(random_poses(3)), results_of(random_poses(3))
    one, two = align({"a": a, "b": b}, dataset="x"), align({"a": b, "b": a}, dataset="y")
    together = concatenate([one, two])
    assert len(together) == 6
    assert together.objects.tolist() == ["x-1"] * 3 + ["y-1"] * 3
    assert_array_equal(together.select(together.dataset == "y").of("a"), two.of("a"))
    with pytest.raises(MismatchError, match="estimates by a, b, but"):
        concatenate([one, align({"b": b, "a": a}, dataset="y")])
