"""Lines of a results CSV: what other people's files have in them is read to the same poses."""

from __future__ import annotations

import csv
import gzip
from pathlib import Path

import pytest
from numpy.testing import assert_array_equal

from graspcast.bop.results import read_results
from graspcast.bop.results_csv import is_results_csv
from graspcast.errors import FormatError
from poses import ROW, write_csv

HEADER = "scene_id,im_id,obj_id,score,R,t,time"
R, T = "1 0 0 0 1 0 0 0 1", "10 20 900"


@pytest.mark.parametrize(
    "row",
    [
        ROW.replace(R, f"[{R}]").replace(T, f"[{T}]"),
        ROW.replace(R, '"[[1, 0, 0], [0, 1, 0], [0, 0, 1]]"').replace(T, '"[10, 20, 900]"'),
        ROW.replace(R, '"[[1. 0. 0.]\n [0. 1. 0.]\n [0. 0. 1.]]"'),
        ROW.replace(R, "1 0 0; 0 1 0; 0 0 1"),
        ROW.replace(R, R.replace(" ", ",")).replace(T, "10, 20, 900"),
        ROW.replace(R, f"[{R}]".replace(" ", ", ")).replace(T, f"({T})".replace(" ", ",")),
        ROW.replace(",", ";"),
        ROW.replace(",", "\t"),
    ],
)
@pytest.mark.parametrize("has", ["header", "no header", "no time"])
def test_however_the_numbers_are_separated(tmp_path: Path, row: str, has: str) -> None:
    mark = next((m for m in ";\t" if row.count(m) > 5), ",")
    row, header = row.replace(f"1{mark}2{mark}3", f"1{mark}2{mark}7"), HEADER
    if has == "no time":
        row, header = row.rpartition(mark)[0], header.rpartition(",")[0]
    path = tmp_path / "r.csv"
    path.write_text(f"{header.replace(',', mark)}\n{row}\n" if has == "header" else f"{row}\n")
    expected = read_results(write_csv(tmp_path / "e.csv", ROW))
    results = read_results(path)
    assert (results.obj_id.tolist(), results.time_s.tolist()) == ([7], [-1.0])
    assert_array_equal(results.cam_T_obj, expected.cam_T_obj)
    assert results.line.tolist()[0] >= (2 if has == "header" else 1)


def test_a_line_of_another_width_is_named(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "r.csv", ROW.replace(R, R.replace(" ", ",")), header=ROW)
    with pytest.raises(FormatError, match="line 2: does not have the 7 fields"):
        read_results(path)


def test_a_compressed_file_is_unpacked(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "r.csv", ROW)
    packed = tmp_path / "r.csv.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    assert_array_equal(read_results(packed).cam_T_obj, read_results(path).cam_T_obj)


def test_what_cannot_be_parsed_as_csv_is_named_by_its_reader(tmp_path: Path) -> None:
    long = "1" * (csv.field_size_limit() + 1)
    assert is_results_csv(long)
    (tmp_path / "r.csv").write_text(long)
    with pytest.raises(FormatError, match=r"r\.csv.*is not a CSV file"):
        read_results(tmp_path / "r.csv")


def test_a_results_csv_is_known_by_its_first_line() -> None:
    assert is_results_csv(f"scene_id, im_id\n{ROW}")
    assert is_results_csv(ROW)
    assert not is_results_csv("a,b\n1,2\n")
