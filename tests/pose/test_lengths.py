"""Lengths in a wrong unit are found, and the unit that fits is named."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from graspcast.pose.lengths import METRES, UNIT_NAMES, Reference, between, shown, unit_problem

ACROSS = Reference("the mesh is 102 mm across", 0.100, 0.104)
HAND = Reference("a hand grasps 5 mm to 1 m", 0.005, 1.0, usual_m=(0.02, 0.4))


@pytest.mark.parametrize("read", METRES)
@pytest.mark.parametrize("meant", METRES)
def test_the_unit_that_fits_is_named(meant: str, read: str) -> None:
    as_read = 0.102 / METRES[meant] * METRES[read]
    said = unit_problem("the diameter", as_read, ACROSS, unit=read)
    if meant == read:
        assert said == ""
    else:
        asked = f"is it in {UNIT_NAMES[meant]} (102 mm), not in {UNIT_NAMES[read]}?"
        assert said == (f"the diameter is {shown(as_read)}, but the mesh is 102 mm across; {asked}")


@given(st.floats(0.005, 1.0))
def test_what_fits_has_no_problem(length: float) -> None:
    assert unit_problem("it", length, HAND, unit="mm") == ""


def test_all_units_that_fit_are_named_the_likeliest_first() -> None:
    said = unit_problem("it", 0.0045, HAND, unit="mm")
    assert "in inches (114 mm) or in centimetres (45 mm), not in millimetres" in said


def test_no_unit_is_suggested_where_none_fits() -> None:
    assert (
        unit_problem("it", 1e-9, HAND, unit="mm") == "it is 1e-06 mm, but a hand grasps 5 mm to 1 m"
    )


def test_where_the_unit_read_is_unknown_the_likeliest_mistake_is_named() -> None:
    assert "is it in millimetres (100 mm), not in metres?" in unit_problem("it", 100.0, HAND)
    assert "is it in metres (100 mm), not in millimetres?" in unit_problem("it", 1e-4, HAND)


def test_an_unknown_length_has_no_problem() -> None:
    assert unit_problem("it", float("nan"), HAND, unit="mm") == ""


def test_lengths_are_shown_in_millimetres_or_metres() -> None:
    assert [shown(x) for x in (0.0008, 0.102, 0.822, 800.0, 1e300)] == [
        "0.8 mm",
        "102 mm",
        "0.82 m",
        "800 m",
        "1e+300 m",
    ]
    assert between(0.102, 0.123) == "102 to 123 mm"
    assert between(0.09, 1.2) == "90 mm to 1.20 m"
    assert between(0.1, 0.1) == "100 mm"


def test_a_length_that_is_not_known_says_so() -> None:
    assert shown(float("nan")) == shown(float("inf")) == "unknown"
