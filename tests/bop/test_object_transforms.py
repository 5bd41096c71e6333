"""Transforms of objects' frames, as text and in JSON files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from graspcast.bop.object_transforms import (
    is_file,
    parse_object_transform,
    read_object_transforms,
)
from graspcast.errors import FormatError
from pose_files import write_json

MOVED = [[1, 0, 0, 10], [0, 1, 0, -20], [0, 0, 1, 0], [0, 0, 0, 1]]
METRES = np.array(MOVED) * np.array([1, 1, 1, 0.001]).reshape(1, 4)
METRES[3, 3] = 1


@pytest.mark.parametrize(
    "content",
    [
        METRES.tolist(),
        np.ravel(METRES).tolist(),
        {"5": METRES.tolist()},
        {"obj_id": 5, "transform": METRES.tolist()},
        {"unit": "mm", "transform": MOVED},
        {"unit": "cm", "5": [[1, 0, 0, 1], [0, 1, 0, -2], [0, 0, 1, 0], [0, 0, 0, 1]]},
    ],
)
def test_files_of_transforms(tmp_path: Path, content: Any) -> None:
    ((number, T),) = read_object_transforms(write_json(tmp_path / "T.json", content)).items()
    assert number in (None, 5)
    assert_allclose(T, METRES)


@pytest.mark.parametrize("text", ["1 0 0 .01 0 1 0 -.02 0 0 1 0 0 0 0 1", str(METRES.tolist())])
def test_text(text: str) -> None:
    assert_allclose(parse_object_transform(text, "text"), METRES)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (MOVED, "its translation is 22 m, .*is it in millimetres .*, not in metres"),
        ({"unit": "mm", "5": METRES.tolist()}, "is it in metres .*, not in millimetres"),
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
    T = parse_object_transform("0 -1 0 0.0002 1 0 0 0 0 0 1 0 0 0 0 1", "text")
    assert_allclose(T[:3, 3], [0.0002, 0, 0])


def test_an_object_in_a_matrix_s_place_is_refused() -> None:
    with pytest.raises(FormatError, match="T, object 5: should be a 4x4 matrix"):
        parse_object_transform({"transform": MOVED}, "T", where="object 5")


def test_a_matrix_is_told_from_a_file_s_name(tmp_path: Path) -> None:
    assert is_file("T.json") and is_file("T.JSON.GZ") and not is_file("1 0 0 0")
    (tmp_path / "T").write_text("")
    assert is_file(str(tmp_path / "T"))
