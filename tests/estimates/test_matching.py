"""Estimates against ground truth: which instance is meant."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from graspcast.bop.dataset import GroundTruth
from graspcast.bop.results import Results
from graspcast.errors import MismatchError
from graspcast.estimates.matching import match
from poses import results_of


def truth_of(poses: np.ndarray, *, im_id: list[int], obj_id: list[int]) -> GroundTruth:
    return GroundTruth(
        scene_id=np.ones(len(poses), int),
        im_id=np.array(im_id),
        obj_id=np.array(obj_id),
        gt_id=np.zeros(len(poses), int),
        cam_T_obj=poses,
        visib_fract=np.ones(len(poses)),
    )


def at(*positions: tuple[float, float]) -> np.ndarray:
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :2, 3] = positions
    poses[:, 2, 3] = 1
    return poses


def detections(poses: np.ndarray, *, im_id: list[int], obj_id: list[int]) -> Results:
    return dataclasses.replace(results_of(poses), im_id=np.array(im_id), obj_id=np.array(obj_id))


def test_several_of_one_object_are_paired_with_the_smallest_total() -> None:
    truth = truth_of(at((0, 0), (0.5, 0), (9, 9)), im_id=[0, 0, 0], obj_id=[1, 1, 2])
    # The nearest true instance of both is the first; the second one gets it.
    found = detections(at((0.2, 0), (0.01, 0)), im_id=[0, 0], obj_id=[1, 1])
    assert match(found, truth).tolist() == [1, 0]


def test_what_has_no_true_instance_is_minus_one() -> None:
    truth = truth_of(at((0, 0), (0.5, 0)), im_id=[0, 1], obj_id=[1, 1])
    found = detections(
        at((0.4, 0), (0, 0), (0, 0), (0, 0), (0.1, 0)),
        im_id=[1, 0, 2, 0, 0],
        obj_id=[1, 2, 1, 1, 1],
    )
    # Another object, another image, and a second detection of the only instance.
    assert match(found, truth).tolist() == [1, -1, -1, 0, -1]


def test_estimates_of_another_dataset_are_refused() -> None:
    truth = dataclasses.replace(truth_of(at((0, 0)), im_id=[0], obj_id=[1]), source="lmo/test")
    found = dataclasses.replace(
        results_of(at((0, 0), (0, 0)), scene_id=48), source="a_ycbv-test.csv"
    )
    with pytest.raises(MismatchError) as caught:
        match(found, truth)
    assert str(caught.value) == (
        "a_ycbv-test.csv: none of its 2 estimates is of an instance that lmo/test has; is it a CSV "
        "of another dataset or split?"
    )


def test_no_estimates_match_nothing() -> None:
    truth = truth_of(at((0, 0)), im_id=[0], obj_id=[1])
    assert match(results_of(at((0, 0))).select(np.zeros(1, bool)), truth).shape == (0,)
