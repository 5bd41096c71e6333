"""Options of pose errors that no estimator has made."""

from __future__ import annotations

import argparse

import pytest

from graspcast.cli.error_options import (
    add_covariance,
    add_tails,
    deviations_of,
    drawn_errors,
    told_deviations,
)
from graspcast.errors import InputError


def parsed(*arguments: str) -> argparse.Namespace:
    verb = argparse.ArgumentParser()
    add_covariance(verb, "for a test")
    add_tails(verb)
    verb.add_argument("--estimates", action="append", default=[])
    verb.add_argument("--seed", type=int, default=0)
    return verb.parse_args(arguments)


def test_deviations_are_in_metres_and_radians() -> None:
    given = deviations_of(parsed("--deviations", "2", "8.5", "4"))
    assert given == pytest.approx((0.002, 0.0085, 0.0698), rel=1e-3)
    assert given is not None
    assert "2 mm across and 8.5 mm along the viewing ray, and 4°" in told_deviations(given)
    assert deviations_of(parsed()) is None


@pytest.mark.parametrize("value", ["0", "-1", "nan", "inf", "wide"])
def test_a_deviation_is_above_zero(value: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parsed("--deviations", "1", value, "1")
    assert "above zero" in capsys.readouterr().err


def test_deviations_in_metres_and_radians_are_found_out() -> None:
    with pytest.raises(InputError, match="are they in metres and radians"):
        deviations_of(parsed("--deviations", "0.002", "0.008", "0.07"))


def test_a_table_and_deviations_exclude_each_other() -> None:
    with pytest.raises(InputError, match="exclude each other"):
        deviations_of(parsed("--deviations", "1", "1", "1", "--covariances", "a.csv"))


def test_tails_are_of_drawn_errors_and_above_two(capsys: pytest.CaptureFixture[str]) -> None:
    given = ["--deviations", "2", "8", "4"]
    normal = drawn_errors(parsed(*given, "--tails", "inf"))
    assert normal is not None and "normal" in normal.sources["drawn errors"]
    default = drawn_errors(parsed(*given))
    assert default is not None and "4 degrees of freedom" in default.sources["drawn errors"]
    assert drawn_errors(parsed()) is None
    with pytest.raises(InputError, match="tails are of errors that are drawn"):
        drawn_errors(parsed("--tails", "5"))
    with pytest.raises(InputError, match="one or the other"):
        drawn_errors(parsed(*given, "--estimates", "a=b.csv"))
    with pytest.raises(SystemExit):
        parsed("--tails", "2")
    assert "above 2" in capsys.readouterr().err
