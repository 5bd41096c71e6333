"""What is stated about a file of poses, and what it says itself."""

from __future__ import annotations

import pytest

from graspcast.bop.pose_rows import Stated
from graspcast.errors import FormatError


@pytest.mark.parametrize(
    ("name", "number"),
    [("obj_000005", 5), ("ycbv-obj_000012", 12), ("lmo/obj_1", 1), ("7", 7), ("mug", 3)],
)
def test_objects_by_name(name: str, number: int) -> None:
    assert Stated(objects={"mug": 3}).object_number(name, [name], "f", None) == number


def test_a_number_without_a_name_is_that_of_the_only_object() -> None:
    stated = Stated(objects={"": 3})
    assert stated.object_number("cup", ["cup", "cup"], "f", None) == 3
    with pytest.raises(FormatError, match=r"which object is 'cup'.* the file has 'cup', 'pot'"):
        stated.object_number("cup", ["cup", "pot"], "f", "entry 0")


def test_what_a_file_states_is_taken_unless_it_means_nothing() -> None:
    assert Stated().number("im_id", 4, "f", None) == 4
    assert Stated(im_id=7).number("im_id", 0, "f", None) == 7
    with pytest.raises(FormatError, match="is of image 4, not of 7"):
        Stated(im_id=7).number("im_id", 4, "f", None)
