"""Answers as records of the log."""

from __future__ import annotations

import numpy as np

from graspcast.runtime.answer import Answer
from graspcast.runtime.decisions import without_pose
from graspcast.runtime.frame import Estimate, Frame
from graspcast.runtime.recording import frame_record


def test_a_record_holds_the_frame_as_it_came_and_who_decided() -> None:
    wrong = np.full((4, 4), np.nan)
    frame = Frame({"a": [Estimate("d-1", wrong, 0.3)], "b": []}, np.eye(4), time_s=1.0)
    some = [without_pose("d-1", "why", gripper="parallel", looks=2) for _ in range(2)]
    record = frame_record(
        frame,
        Answer("e", 2, tuple(some)),
        digests=("m", None),
        others={some[1].id: ("n", "c")},
        source="node",
    )
    assert (record.episode, record.look, record.source, record.model) == ("e", 2, "node", "m")
    ((name, pose, score),) = record.estimates["a"]
    assert name == "d-1" and score == 0.3 and np.isnan(pose).all()
    assert [d.model for d in record.decisions] == [None, "n"]
    assert [d.certificate for d in record.decisions] == [None, "c"]
