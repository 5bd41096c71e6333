"""Numbers given as options."""

from __future__ import annotations

import argparse

import pytest

from graspcast.cli.numbers import number_type

angle = number_type(lambda value: 0 <= value <= 180, "degrees from 0 to 180 are")


@pytest.mark.parametrize("text", ["0", "12.5", "180", "1e2"])
def test_a_number_in_range_is_taken(text: str) -> None:
    assert angle(text) == float(text)


@pytest.mark.parametrize("text", ["-1", "180.1", "nan", "inf", "wide", ""])
def test_what_is_out_of_range_or_no_number_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError) as error:
        angle(text)
    assert str(error.value) == f"degrees from 0 to 180 are needed, not {text!r}"
