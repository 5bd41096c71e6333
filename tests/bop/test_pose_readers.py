"""Readers of poses: where none knows a file, each says what it misses."""

from __future__ import annotations

from pathlib import Path

import pytest

from graspcast.bop.pose_rows import Stated
from graspcast.bop.results import read_results
from graspcast.errors import FormatError
from poses import ROW, write_csv

NAMES = ("BOP results CSV: ", "SAM-6D's JSON: ", "MegaPose or happypose: ", "ob_in_cam/IMAGE.txt: ")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("# notes\n", "its first line, '# notes', is neither scene_id,im_id"),
        ("", "its first line, ''"),
        ("1 2 3\n", "it is not 16 numbers"),
        ("[1, 2", "it is not valid JSON"),
        ('{"a": 1}', "it is no list of objects"),
        (
            '[{"scene_id": 1, "image_id": 2, "category_id": 5, "bbox": []}]',
            "no R, t in its entries",
        ),
    ],
)
def test_every_reader_that_was_tried_is_named(tmp_path: Path, content: str, says: str) -> None:
    path = tmp_path / "poses.txt"
    path.write_text(content)
    with pytest.raises(FormatError, match=r"poses.txt: is in none of the forms") as caught:
        read_results(path)
    assert says in str(caught.value)
    assert all(name in str(caught.value) for name in NAMES)


def test_a_directory_without_poses(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"it is a directory.* no \.txt file is in the directory"):
        read_results(tmp_path)


def test_the_unit_may_be_stated(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "r.csv", ROW.replace("10 20 900", "0.01 0.02 0.9"))
    with pytest.raises(FormatError, match=r"is it in metres .*, not in millimetres"):
        read_results(path)
    found = read_results(path, stated=Stated(unit="m"))
    assert found.cam_T_obj[0, :3, 3].tolist() == [0.01, 0.02, 0.9]
    with pytest.raises(FormatError, match=r"in metres .*, not in inches") as caught:
        read_results(path, stated=Stated(unit="inch"))
    assert caught.value.parameters == ("length_unit",)
