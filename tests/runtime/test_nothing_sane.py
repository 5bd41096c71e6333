"""Objects without a pose that can be."""

from __future__ import annotations

import numpy as np

from graspcast.runtime.frame import Estimate, Frame
from graspcast.runtime.nothing_sane import nothing_sane, placeholder_notes


def test_what_is_wrong_is_said_of_each_estimator() -> None:
    behind = np.eye(4)
    behind[2, 3] = -1.0
    frame = Frame(
        {
            "a": [Estimate("d-1", behind), Estimate("d-2", np.eye(4)), Estimate("d-3", behind)],
            "b": [Estimate("d-1", np.full((4, 4), np.nan))],
        }
    )
    found = nothing_sane(frame, {"d-3"}, lambda names: np.full(len(names), np.nan))
    assert list(found) == ["d-1"]
    assert "a (its pose lies behind the camera" in found["d-1"]
    assert "b (its pose holds numbers that are not finite)" in found["d-1"]


def test_placeholders_are_named_by_estimator() -> None:
    seen = np.eye(4)
    seen[2, 3] = 1.0
    frame = Frame(
        {
            "a": [Estimate("d-1", seen), Estimate("d-2", np.eye(4))],
            "b": [Estimate("d-1", seen)],
            "c": [],
        }
    )
    (note,) = placeholder_notes(frame)
    assert note.startswith("1 of 2 poses by a lie at the camera's centre") and "d-2" in note


def test_a_transposed_pose_is_no_placeholder() -> None:
    seen = np.eye(4)
    seen[2, 3] = 1.0
    frame = Frame({"a": [Estimate("d-1", seen.T)]})
    assert placeholder_notes(frame) == []
    found = nothing_sane(frame, (), lambda names: np.full(len(names), np.nan))
    assert "looks transposed" in found["d-1"]
