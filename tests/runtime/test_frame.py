"""Frames are checked where they come in."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from graspcast.errors import InputError
from graspcast.runtime.frame import MAX_ESTIMATES, Estimate, Frame

POSE = np.eye(4) + np.array([[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0.7], [0, 0, 0, 0]])
GOOD = Estimate("ycbv-5", POSE, 0.5)


@pytest.mark.ill_typed
@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("ycbv5", POSE), "DATASET-NUMBER, for example lmo-5, not 'ycbv5'"),
        ((5, POSE), "DATASET-NUMBER, for example ycbv-5, not 5"),
        (("y" * 1000 + "-5", POSE), "DATASET-NUMBER"),
        (("ycbv-99999999999", POSE), "number of ycbv-99999999999 is larger"),
        (("ycbv-5", POSE[:3]), "ycbv-5 is not a 4x4 matrix of numbers"),
        (("ycbv-5", "pose"), "ycbv-5 is not a 4x4 matrix of numbers"),
        (("ycbv-5", POSE, float("nan")), "score should be a number"),
        (("ycbv-5", POSE, "high"), "score should be a number"),
        (("ycbv-5", POSE, True), "score should be a number"),
    ],
)
def test_what_is_no_estimate_is_refused(given: tuple[Any, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Estimate(*given)


@pytest.mark.ill_typed
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"estimates": [GOOD]}, "estimates should be a mapping"),
        ({"estimates": {"epos": GOOD}}, "a list of what is of type Estimate"),
        ({"estimates": {5: [GOOD]}}, "estimates should be a mapping"),
        ({"estimates": {"epos": [POSE]}}, "a list of what is of type Estimate"),
        (
            {"estimates": {"epos": [GOOD] * (MAX_ESTIMATES + 1)}},
            "1001 estimates are too many",
        ),
        ({"estimates": {f"e{i}": [] for i in range(33)}}, "33 estimators are too many; at most 32"),
        ({"world_T_cam": np.full((4, 4), np.nan)}, "world_T_cam holds numbers that are not finite"),
        ({"world_T_cam": np.diag([2.0, 2, 2, 1])}, "world_T_cam has a rotation scaled by 2"),
        ({"world_T_cam": np.diag([1.0, 1, -1, 1])}, "world_T_cam has a mirrored rotation"),
        ({"K": np.zeros((3, 3))}, "K "),
        ({"K": "K"}, "K is not 3x3 finite numbers"),
        ({"time_s": float("inf")}, "time_s should be a number"),
        ({"reachable": "side"}, "reachable should be a list"),
        ({"reachable": {"ycbv-5": "side"}}, "reachable should be a mapping"),
    ],
)
def test_what_is_no_frame_is_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Frame(**{"estimates": {"epos": [GOOD]}, **given})


@pytest.mark.ill_typed
def test_a_frame_keeps_what_it_is_given() -> None:
    given = {"epos": [GOOD], "gdrnpp": []}
    frame = Frame(given, POSE.tolist(), [[600, 0, 320], [0, 600, 240], [0, 0, 1]], 3)
    given["gdrnpp"].append(GOOD)
    assert len(frame) == 1 and frame.time_s == 3.0
    assert frame.datasets == ("ycbv",)
    assert frame.world_T_cam is not None and frame.world_T_cam.dtype == np.float64
    assert repr(frame) == "Frame(1 estimate by epos, gdrnpp, with camera pose)"
    assert repr(GOOD) == "Estimate(ycbv-5, score 0.5)"


def test_a_pose_that_cannot_be_is_no_reason_to_refuse_the_frame() -> None:
    assert len(Frame({"epos": [Estimate("ycbv-5", np.full((4, 4), np.nan)), GOOD]})) == 2


def test_a_frame_is_split_by_dataset_and_estimator() -> None:
    some = [Estimate("d-1", POSE, 0.5), Estimate("e-2", POSE), Estimate("d-3", POSE)]
    found = Frame({"a": some}).results("d", ("a", "b"))
    assert found["a"].obj_id.tolist() == [1, 3]
    assert found["a"].score.tolist() == [0.5, 1.0]
    assert len(found["b"]) == 0
