"""Transforms of objects' frames, as text and in JSON files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from graspcast.bop.object_transforms import parse_object_transform, read_object_transforms
from graspcast.errors import FormatError
from pose_files import write_json

MOVED = [[1, 0, 0, 10], [0, 1, 0, -20], [0, 0, 1, 0], [0, 0, 0, 1]]
METRES = np.array(MOVED) * np.array([1, 1, 1, 0.001]).reshape(1, 4)
METRES[3, 3] = 1


@pytest.mark.parametrize(
    "content",
    [
        MOVED,
        np.ravel(MOVED).tolist(),
        {"5": MOVED},
        {"obj_id": 5, "transform": MOVED},
        {"unit": "m", "transform": METRES.tolist()},
        {"unit": "cm", "5": [[1, 0, 0, 1], [0, 1, 0, -2], [0, 0, 1, 0], [0, 0, 0, 1]]},
    ],
)
def test_files_of_transforms(tmp_path: Path, content: Any) -> None:
    ((number, T),) = read_object_transforms(write_json(tmp_path / "T.json", content)).items()
    assert number in (None, 5)
    assert_allclose(T, METRES)


@pytest.mark.parametrize("text", ["1 0 0 10 0 1 0 -20 0 0 1 0 0 0 0 1", str(MOVED)])
def test_text(text: str) -> None:
    assert_allclose(parse_object_transform(text, "text"), METRES)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (METRES.tolist(), "its translation is 0.0224 mm, .*is it in metres .*, not in millimetres"),
        (np.transpose(MOVED).tolist(), "the last row is 10 -20 0 1, not 0 0 0 1"),
        (np.diag([1, 1, -1, 1]).tolist(), "is no rotation: it has a mirrored rotation"),
        ([1, 2, 3], "should be 16 finite numbers"),
        ({}, "holds no transform"),
        ({"mug": MOVED}, "'mug' is not a whole number"),
        ({"unit": "ft", "5": MOVED}, "'ft' is none of mm, cm, m, inch"),
        (5, "should hold a 4x4 matrix"),
    ],
)
def test_what_is_no_transform(tmp_path: Path, content: Any, says: str) -> None:
    with pytest.raises(FormatError, match=says):
        read_object_transforms(write_json(tmp_path / "T.json", content))


def test_a_rotation_may_leave_a_short_translation() -> None:
    T = parse_object_transform("0 -1 0 0.2 1 0 0 0 0 0 1 0 0 0 0 1", "text")
    assert_allclose(T[:3, 3], [0.0002, 0, 0])
