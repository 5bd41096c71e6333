"""Lengths in a wrong unit are found, and the unit that fits is named."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from graspcast.pose.lengths import (
    METRES,
    UNIT_NAMES,
    Reference,
    between,
    fitting_units,
    shown,
    unit_problem,
)

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


@pytest.mark.parametrize(
    ("length", "text"),
    [
        (0.4999, "500 mm"),
        (0.5, "0.50 m"),
        (-0.1, "-100 mm"),
        (-0.6, "-0.60 m"),
        (9.99, "9.99 m"),
        (10.0, "10 m"),
        (99_999.0, "99999 m"),
        (100_000.0, "1e+05 m"),
        (float("inf"), "unknown"),
        (float("nan"), "unknown"),
    ],
)
def test_where_the_format_of_a_length_changes(length: float, text: str) -> None:
    assert shown(length) == text


def test_the_ends_of_a_range_belong_to_it() -> None:
    reference = Reference("it is 1 to 2 m", 1.0, 2.0)
    assert [reference.fits(x) for x in (0.999, 1.0, 2.0, 2.001)] == [False, True, True, False]
    assert fitting_units(1000.0, reference) == [("mm", "m", 1.0)]
    assert fitting_units(2000.0, reference) == [("mm", "m", 2.0)]
    assert fitting_units(2001.0, reference) == []


def test_units_are_named_in_the_order_of_their_distance_from_the_middle() -> None:
    """In the logarithm: of 1 mm to 10 m the middle is 0.1 m."""
    wide = Reference("it is anything", 0.001, 10.0)
    found = fitting_units(0.002, wide, unit="mm")
    assert [meant for meant, _, _ in found] == ["inch", "cm", "m"]
    assert [metres for _, _, metres in found] == pytest.approx([0.0508, 0.02, 2.0])
    found = fitting_units(0.0008, wide, unit="mm")
    assert [meant for meant, _, _ in found] == ["inch", "m", "cm"]


def test_ranges_of_one_unit_name_it_once() -> None:
    assert between(1.0, 2.0) == "1.00 to 2.00 m"
    assert between(0.1, 0.1004) == "100 mm"
