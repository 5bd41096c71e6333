"""Numbers and codes of the grasps of each object."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_array_equal

from graspcast.forecasting.models.targets import Targets

SEVERAL = Targets.of([("d-2", "top"), ("d-1", "side"), ("d-2", "reference"), ("d-2", "top")])


def test_where_objects_have_the_reference_grasp_alone_their_numbers_are_those_of_objects() -> None:
    one = Targets.of_objects(("d-1", "d-2", "d-5"))
    assert one == Targets.of((name, "reference") for name in ("d-5", "d-1", "d-2"))
    assert not one.has_several and len(one) == 3
    assert_array_equal(one.numbers(["d-5", "d-9", "d-1"], "reference"), [2, -1, 0])
    assert_array_equal(one.codes(), np.eye(3))


def test_grasps_are_numbered_object_by_object_and_by_name() -> None:
    assert SEVERAL.has_several and len(SEVERAL) == 3
    assert SEVERAL.grasps == (("side",), ("reference", "top"))
    assert_array_equal(SEVERAL.numbers(["d-1", "d-2"], "top"), [-1, 2])
    assert_array_equal(SEVERAL.object_numbers, [0, 1, 1])
    assert SEVERAL.first == [0, 1]


def test_codes_tell_all_grasps_apart_and_say_which_are_of_one_object() -> None:
    codes = SEVERAL.codes()
    assert_array_equal(codes, [[1, 0, 1, 0], [0, 1, 1, 0], [0, 1, 0, 1]])
    assert len(np.unique(codes, axis=0)) == len(SEVERAL)


def test_a_single_grasp_of_another_name_is_no_reference_grasp() -> None:
    assert Targets.of([("d-1", "top")]).has_several


def test_objects_of_which_any_grasp_is_among_some() -> None:
    assert_array_equal(SEVERAL.any_of(np.array([False, False, True])), [False, True])
