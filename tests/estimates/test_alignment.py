"""K estimators side by side: which detection is which instance."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from graspcast.bop.models import Models
from graspcast.bop.results import Results
from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.alignment import align, concatenate, estimate_ids
from poses import nudged, random_poses, results_of, write_models


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
    b = dataclasses.replace(results_of(nudged(random_poses(5), 1)), im_id=np.array([0, 1, 2, 7, 8]))
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
    b = detections([(0.5, 0.01, 1)], [0.9])
    both = align({"a": a, "b": b}, dataset="d")
    assert both.of("a")[:, 0, 3].tolist() == [0.5]
    assert both.est_id.tolist() == [1]
    assert both.lacking == {"a": 0, "b": 1}
    # With the other as anchor the same pair is its instance 0.
    assert align({"a": a, "b": b}, dataset="d", anchor="b").est_id.tolist() == [0]


@given(st.permutations(range(4)), st.integers(0, 100))
def test_the_anchors_order_of_rows_does_not_matter(order: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    where = [tuple(p) for p in (rng.uniform(-1, 1, size=(4, 3)) + [0, 0, 2]).tolist()]
    scores = [0.9, 0.8, 0.7, 0.6]
    a = detections(where, scores)
    b = detections([where[i] for i in order], [scores[i] for i in order])
    both = align({"a": a, "b": b}, dataset="d", required=False)
    assert_array_equal(both.of("a"), both.of("b"))


def test_messages_list_what_there_is() -> None:
    a, b = results_of(random_poses(2)), results_of(nudged(random_poses(2), 1))
    with pytest.raises(InputError, match="no estimators to align"):
        align({}, dataset="d")
    with pytest.raises(UnknownNameError, match="unknown estimator 'c'; known: a, b"):
        align({"a": a, "b": b}, dataset="d", anchor="c")
    with pytest.raises(UnknownNameError, match=r"'gdrnp' \(did you mean 'gdrnpp'\?\)"):
        align({"epos": a, "gdrnpp": b}, dataset="d").of("gdrnp")
    elsewhere = dataclasses.replace(a, scene_id=a.scene_id + 1)
    with pytest.raises(MismatchError, match=r"no instance of d has a pose by every .* \(a: 2 rows"):
        align({"a": a, "b": elsewhere}, dataset="d")


def test_datasets_are_put_one_after_the_other() -> None:
    a, b = results_of(random_poses(3)), results_of(nudged(random_poses(3), 1))
    one, two = align({"a": a, "b": b}, dataset="x"), align({"a": b, "b": a}, dataset="y")
    together = concatenate([one, two])
    assert len(together) == 6
    assert together.objects.tolist() == ["x-1"] * 3 + ["y-1"] * 3
    assert_array_equal(together.select(together.dataset == "y").of("a"), two.of("a"))
    with pytest.raises(MismatchError, match="estimates by a, b, but"):
        concatenate([one, align({"b": b, "a": a}, dataset="y")])


WRONG = {
    "behind the camera": lambda p: np.diag([1.0, 1, -1, 1]) @ np.diag([-1.0, 1, 1, 1]) @ p,
    "mirrored": lambda p: p @ np.diag([1.0, 1, -1, 1]),
    "scaled by 2": lambda p: p @ np.diag([2.0, 2, 2, 1]),
    "last row 0 0 0 2": lambda p: np.concatenate([p[:, :3], p[:, 3:] * 2], axis=1),
    "not finite": lambda p: np.where(np.eye(4) == 1, np.nan, p),
    "not in metres": lambda p: p * np.where(np.arange(4) == 3, [[1e3]] * 3 + [[1]], 1),
}


@pytest.mark.parametrize("words", WRONG)
def test_a_pose_that_cannot_be_is_no_estimate(words: str) -> None:
    poses = random_poses(6)
    bad = nudged(poses, 1)
    bad[2:3] = WRONG[words](bad[2:3])
    both = align({"a": results_of(poses), "b": results_of(bad)}, dataset="d")
    assert both.im_id.tolist() == [0, 1, 3, 4, 5]
    assert both.lacking == {"a": 0, "b": 1}
    (said,) = both.refused
    assert said.startswith("1 of 6 poses by b cannot be: one ") and words in said
    (gap,) = both.incomplete
    assert gap.reason.startswith("no estimate by b (its pose ") and words in gap.reason
    # As the anchor's it is no instance.
    both = align({"b": results_of(bad), "a": results_of(poses)}, dataset="d")
    assert both.im_id.tolist() == [0, 1, 3, 4, 5] and not both.incomplete


def test_placeholders_are_no_estimates_and_need_no_words() -> None:
    poses = random_poses(6)
    empty = nudged(poses, 1)
    empty[4, :3, 3] = 0
    both = align({"a": results_of(poses), "b": results_of(empty)}, dataset="d")
    assert both.lacking == {"a": 0, "b": 1} and both.refused == ()
    assert both.incomplete[0].reason == "no estimate by b"


def test_nothing_but_poses_that_cannot_be_is_refused_with_the_reason() -> None:
    poses = random_poses(6)
    with pytest.raises(MismatchError, match=r"6 of 6 poses by b .* OpenGL's camera frame"):
        opengl = results_of(np.diag([1.0, -1, -1, 1]) @ poses)
        align({"a": results_of(poses), "b": opengl}, dataset="d")


def test_distances_are_held_against_the_objects_size(tmp_path: Path) -> None:
    models = {"d": Models(write_models(tmp_path))}
    poses = random_poses(6)
    far = nudged(poses, 1)
    far[:, :3, 3] *= 100
    with pytest.raises(MismatchError, match="is it in centimetres"):
        tables = {"a": results_of(poses), "b": results_of(far)}
        align(tables, dataset="d", models=models)


def test_one_estimator_with_two_names_is_refused() -> None:
    poses = random_poses(6)
    a, other = results_of(poses), results_of(nudged(poses, 1))
    for copy in (a, results_of(poses.copy()), a.select(np.arange(6)[::-1]), a.select(np.arange(3))):
        with pytest.raises(InputError, match="c has the same pose as a in each of"):
            align({"a": a, "b": other, "c": copy}, dataset="d")
    assert len(align({"a": a, "c": a}, dataset="d", required=False)) == 6


def test_an_estimator_of_another_convention_is_named() -> None:
    poses = random_poses(12)
    turned = nudged(poses, 2)
    turned[:, :3, :3] = np.swapaxes(turned[:, :3, :3], 1, 2)
    tables = {"a": results_of(poses), "b": results_of(nudged(poses, 1)), "c": results_of(turned)}
    with pytest.raises(MismatchError, match=r"estimates by c agree .* transposed"):
        align(tables, dataset="d")
    assert len(align(tables, dataset="d", required=False)) == 12


def test_every_estimator_s_scores_go_with_its_poses() -> None:
    poses, score = random_poses(6), np.linspace(0.1, 0.9, 6)
    a = dataclasses.replace(results_of(poses), score=score)
    b = dataclasses.replace(results_of(nudged(poses, 1)), score=1 - score)
    shuffled = a.select(np.random.default_rng(0).permutation(6))
    both = align({"a": shuffled, "b": b}, dataset="d")
    assert_array_equal(both.seen["score"], [score, 1 - score])
    assert_array_equal(both.only("b").seen["score"], [1 - score])
    assert_array_equal(both.select(np.array([4, 1])).seen["score"][0], score[[4, 1]])
    twice = concatenate([both, dataclasses.replace(both, seen={**both.seen, "f": score[None]})])
    assert list(twice.seen) == ["score"]
    assert_array_equal(twice.seen["score"][0], np.tile(score, 2))


def test_a_row_left_out_for_its_pose_does_not_shift_the_scores_of_others() -> None:
    poses = random_poses(3)
    poses[0, 2, 3] = -1.0  # behind the camera, with the highest score
    one = np.zeros(3, np.int64)
    a = dataclasses.replace(results_of(poses), im_id=one, score=np.array([0.9, 0.5, 0.1]))
    found = align({"a": a}, dataset="d")
    assert found.est_id.tolist() == [0, 1]
    assert found.seen["score"].tolist() == [[0.5, 0.1]]
