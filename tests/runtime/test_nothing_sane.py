"""Objects without a pose that can be."""

from __future__ import annotations

import numpy as np

from graspcast.runtime.frame import Estimate, Frame
from graspcast.runtime.nothing_sane import nothing_sane


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
