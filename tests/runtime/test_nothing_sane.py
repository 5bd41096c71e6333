"""Objects without a pose that can be."""

from __future__ import annotations

import numpy as np

from graspcast.runtime.frame import Estimate, Frame
from graspcast.runtime.nothing_sane import left_out_notes, nothing_sane


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
    (note,) = left_out_notes(frame)
    assert note.startswith("1 of 2 poses by a lie at the camera's centre") and "d-2" in note


def test_a_transposed_pose_is_no_placeholder() -> None:
    seen = np.eye(4)
    seen[2, 3] = 1.0
    frame = Frame({"a": [Estimate("d-1", seen.T)]})
    assert left_out_notes(frame) == []
    found = nothing_sane(frame, (), lambda names: np.full(len(names), np.nan))
    assert "looks transposed" in found["d-1"]


def test_a_pose_given_twice_is_kept_once_with_the_higher_score() -> None:
    seen, beside = np.eye(4), np.eye(4)
    seen[2, 3] = beside[2, 3] = 1.0
    beside[0, 3] = 0.2
    given = [
        Estimate("d-1", seen, 0.2),
        Estimate("d-1", beside, 0.4),
        Estimate("d-1", seen.copy(), 0.9),
        Estimate("d-2", seen),
    ]
    frame = Frame({"a": given, "b": given[:2]})
    assert [(e.object_name, e.score) for e in frame.estimates["a"]] == [
        ("d-1", 0.9),
        ("d-1", 0.4),
        ("d-2", 1.0),
    ]
    assert frame.repeated == {"a": ["d-1"]}
    (note,) = left_out_notes(frame)
    assert note == "a gave 1 pose again, bit by bit, and each is judged once: d-1"


def test_placeholders_are_no_repeats() -> None:
    frame = Frame({"a": [Estimate("d-1", np.eye(4))] * 2})
    assert len(frame) == 2 and not frame.repeated
    (note,) = left_out_notes(frame)
    assert note.startswith("2 of 2 poses by a lie at the camera's centre")
