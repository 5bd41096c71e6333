"""Ground truth of a BOP dataset: read, and what is wrong with it named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from graspcast.bop.ground_truth import read_ground_truth
from graspcast.errors import FormatError
from scene_files import EYE, entry, write_scene


def test_slightly_bad_true_rotations_are_projected(tmp_path: Path) -> None:
    scenes = write_scene(tmp_path, {"0": [entry(cam_R_m2c=[*EYE[:8], 1.008])]})
    assert_array_equal(read_ground_truth(scenes).cam_T_obj[0, :3, :3], np.eye(3))


@pytest.mark.parametrize(
    ("images", "says"),
    [
        ({"0": [entry(cam_R_m2c=[*EYE[:8], 1.1])]}, "image 0, object 1: cam_R_m2c is 0.1 away"),
        ({"0": [entry(cam_t_m2c=[0, 0])]}, "image 0, instance 0: should be 3 finite numbers"),
        ({"0": [{"obj_id": 1}]}, "no 'cam_R_m2c'; found obj_id"),
        ({"x": [entry()]}, "'x' is not a whole number"),
        ({"0": entry()}, "image 0: should be a list of instances"),
        ({"0": [3]}, "image 0, instance 0: should be an object"),
        ({"0": [entry(obj_id=1.5)]}, "1.5 is not a whole number"),
        ([], "should hold an object at its top level"),
    ],
)
def test_wrong_ground_truth_is_named(tmp_path: Path, images: Any, says: str) -> None:
    scenes = write_scene(tmp_path, images)
    with pytest.raises(FormatError) as caught:
        read_ground_truth(scenes)
    assert says in str(caught.value)
    assert "scene_gt.json" in str(caught.value)


def test_visibility_must_match_the_instances(tmp_path: Path) -> None:
    scenes = write_scene(tmp_path, {"0": [entry()]}, {"0": []})
    with pytest.raises(FormatError, match="should list 1 instances"):
        read_ground_truth(scenes)


@pytest.mark.parametrize("share", [{}, {"visib_fract": None}, {"visib_fract": float("nan")}])
def test_visible_fractions_and_boxes_may_be_missing(tmp_path: Path, share: Any) -> None:
    info = {"0": [share, {"visib_fract": 0.5, "bbox_obj": [1, 2, 30, 40]}]}
    truth = read_ground_truth(write_scene(tmp_path, {"0": [entry(), entry(2)]}, info))
    assert np.isnan(truth.visib_fract[0]) and truth.visib_fract[1] == 0.5
    assert truth.box_xywh is not None and np.isnan(truth.box_xywh[0]).all()
    assert truth.box_xywh[1].tolist() == [1, 2, 30, 40]


def test_each_instance_needs_an_object(tmp_path: Path) -> None:
    scenes = write_scene(tmp_path, {"0": [entry()]}, {"0": [0.5]})
    with pytest.raises(FormatError, match="image 0: should be an object for each instance"):
        read_ground_truth(scenes)
