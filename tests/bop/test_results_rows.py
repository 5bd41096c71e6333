"""Rows of a BOP results CSV, and every way in which one can be wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from graspcast.bop.results import (
    read_results,
)
from graspcast.errors import FormatError
from poses import ROW, write_csv


def bad(old: str, new: str) -> str:
    assert old in ROW
    return ROW.replace(old, new)


@pytest.mark.parametrize(
    ("row", "says"),
    [
        (bad("1,2,3", "1,x,3"), "im_id is 'x', but should be a whole number"),
        (bad("1,2,3", "1,2,-3"), "obj_id is '-3'"),
        (bad("1,2,3", "1,2,3.0"), "obj_id is '3.0'"),
        (bad("1,2,3", "1,2,1_0"), "obj_id is '1_0', but should be a whole number"),
        (bad("1,2,3", "1,\u0662,3"), "im_id is '\u0662', but should be a whole number"),
        (bad("10 20 900", "10 20 9_00"), "t is '10 20 9_00', but should be three"),
        (bad("0.5", "nan"), "score is 'nan', but should be a finite number"),
        (bad("10 20 900", "10 20"), "t is '10 20', but should be three"),
        (bad("10 20 900", "10 20 inf"), "should be three finite numbers in millimetres"),
        (bad("1 0 0 0 1 0 0 0 1", "1 0 0 0 1 0 0 1"), "R is '1 0 0 0 1 0 0 1'"),
        (bad("1 0 0 0 1 0 0 0 1", "1 0 0 0 1 0 0 0 1.1"), "R is 0.1 away from the nearest"),
        (bad("1 0 0 0 1 0 0 0 1", "1 0 0 0 1 0 0 0 -1"), "R is 2 away from the nearest"),
        (bad("1 0 0 0 1 0 0 0 1", "1 0 0 0 1 0 0 0 -1"), "the pose has a mirrored rotation"),
        (bad("1 0 0 0 1 0 0 0 1", "2 0 0 0 2 0 0 0 2"), "the pose has a rotation scaled by 2"),
        (bad("10 20 900", "10 20 -900"), "behind the camera (t_z is -900 mm)"),
        (bad(",-1", ",-1,7"), "does not have the 7 fields of the header"),
        (ROW, "repeats the instance and pose of line 2"),
    ],
)
def test_a_bad_row_is_named_or_skipped(tmp_path: Path, row: str, says: str) -> None:
    path = write_csv(tmp_path / "r.csv", ROW, row)
    with pytest.raises(FormatError, match="line 3") as caught:
        read_results(path)
    assert says in str(caught.value)
    assert str(path) in str(caught.value)
    assert caught.value.parameters == ("lenient",)
    lenient = read_results(path, lenient=True)
    assert len(lenient) == 1
    assert lenient.dropped == {"bad row": 1}


@pytest.mark.parametrize("time", ["nan", "-2", "inf", "-1", "", "None", "soon"])
def test_a_time_that_was_not_measured_is_unknown(tmp_path: Path, time: str) -> None:
    results = read_results(write_csv(tmp_path / "r.csv", bad(",-1", f",{time}")))
    assert results.time_s.tolist() == [-1.0]
    assert results.dropped == {}


def test_a_slightly_bad_rotation_is_projected(tmp_path: Path) -> None:
    row = bad("1 0 0 0 1 0 0 0 1", "1 0 0 0 1 0 0 0 1.01")
    pose = read_results(write_csv(tmp_path / "r.csv", row)).cam_T_obj[0]
    assert_array_equal(pose[:3, :3], np.eye(3))


def test_metres_are_noticed(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "r.csv", bad("10 20 900", "0.01 0.02 0.9"))
    with pytest.raises(FormatError, match=r"0\.9 mm, but .*in metres \(0\.90 m\)"):
        read_results(path)


def test_a_placeholder_is_dropped_and_counted(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "r.csv", ROW, bad("10 20 900", "0 0 0"))
    results = read_results(path)
    assert len(results) == 1
    assert results.dropped == {"placeholder": 1}
    assert len(read_results(path, placeholders=True)) == 2


def test_many_poses_behind_the_camera_hint_at_another_convention(tmp_path: Path) -> None:
    rows = [ROW.replace("1,2,3", f"1,{i},3").replace("900", "-900") for i in range(10)]
    with pytest.raises(
        FormatError, match=r"10 of 10 poses lie behind it: .* OpenGL's camera frame"
    ) as e:
        read_results(write_csv(tmp_path / "a.csv", *rows))
    assert e.value.parameters == ("estimates",), "to skip such rows is no remedy"
    rows[:6] = [row.replace("-900", "900") for row in rows[:6]]
    with pytest.raises(FormatError, match=r"4 of 10 poses lie behind it: are they obj_T_cam"):
        read_results(write_csv(tmp_path / "a.csv", *rows))
