"""One-hot encoding."""

from __future__ import annotations

import pytest

from graspcast.errors import UnknownNameError
from graspcast.forecasting.models.encoding import one_hot


def test_one_hot() -> None:
    assert one_hot(["b", "a", "b"], ("a", "b", "c"), "object").tolist() == [
        [0, 1, 0],
        [1, 0, 0],
        [0, 1, 0],
    ]
    with pytest.raises(UnknownNameError, match="unknown gripper 'z'; known: a, b"):
        one_hot(["a", "z"], ("a", "b"), "gripper")
