"""Options of costs, and the table of thresholds that is printed at them."""

from __future__ import annotations

import argparse

import numpy as np
import pytest

from graspcast.cli.cost_options import add_costs, costs_of, print_thresholds
from graspcast.evaluation.best_threshold import Trials
from graspcast.evaluation.threshold_table import threshold_table


def options(*given: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_costs(parser)
    return parser.parse_args(list(given))


def trials(outcomes: bool = True) -> Trials:
    p = np.linspace(0.05, 0.95, 40)
    success = np.arange(40) % 10 < p * 10
    return Trials.of_one_look(
        p, success if outcomes else None, np.repeat(np.arange(8), 5).astype(str)
    )


def test_costs_that_are_not_stated_are_assumed() -> None:
    assert str(costs_of(options())) == "failure 2, skip 0.2, further look 0.05 (a success gains 1)"
    found = costs_of(options("--cost-fail", "3", "--cost-look", "0"))
    assert (found.failure, found.abstention, found.look) == (3.0, 0.2, 0.0)


@pytest.mark.parametrize("value", ["-1", "nan", "inf", "1e400", "2e6", "much", ""])
@pytest.mark.parametrize("name", ["--cost-fail", "--cost-skip", "--cost-look"])
def test_what_is_no_cost_is_refused(
    name: str, value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        options(f"{name}={value}")
    assert "a number from 0 to 1,000,000 is needed" in capsys.readouterr().err


def test_without_costs_no_threshold_is_called_the_best(capsys: pytest.CaptureFixture[str]) -> None:
    given = options()
    print_thresholds(threshold_table(trials(), costs_of(given), asked=0.8), given, "of a test")
    out = capsys.readouterr().out
    assert "40 grasps in 8 scenes, of a test" in out
    assert "--cost-fail, --cost-skip, --cost-look assumed" in out
    assert "in use" in out and "break-even" in out
    assert "best" not in out.replace("State your costs for the best threshold at them.", "")


def test_with_costs_the_best_is_named_with_what_it_is_worth_elsewhere(
    capsys: pytest.CaptureFixture[str],
) -> None:
    given = options("--cost-fail", "1", "--cost-skip", "0", "--cost-look", "0")
    print_thresholds(threshold_table(trials(), costs_of(given)), given, "of a test")
    out = capsys.readouterr().out
    assert "assumed" not in out
    assert "best of these" in out
    assert "Best on these grasps: threshold" in out
    assert "chosen so on some scenes and tried on the others" in out
    assert "At the break-even probability 0.5, which no data chose" in out


def test_what_is_expected_is_not_called_measured(capsys: pytest.CaptureFixture[str]) -> None:
    given = options("--cost-fail", "1")
    table = threshold_table(trials(outcomes=False), costs_of(given), asked=0.5)
    beside = threshold_table(trials(), table.costs, at=[row.threshold for row in table.rows])
    print_thresholds(table, given, "forecasts", measured=beside)
    out = capsys.readouterr().out
    assert "expected to succeed" in out
    assert "succeeded in training scenes, held out" in out
    assert "that is what the forecasts say of themselves" in out
    assert "Best on these grasps" not in out


def test_attempting_nothing_may_be_the_best(capsys: pytest.CaptureFixture[str]) -> None:
    given = options("--cost-fail", "1000", "--cost-skip", "0")
    failing = Trials.of_one_look(np.full(4, 0.9), np.zeros(4), np.array(["d/1", "d/2"] * 2))
    print_thresholds(threshold_table(failing, costs_of(given)), given, "of a test")
    assert "Best on these grasps: attempting nothing" in capsys.readouterr().out


def test_thresholds_that_were_not_recorded_are_said_to_be_unknown(
    capsys: pytest.CaptureFixture[str],
) -> None:
    given = options()
    table = threshold_table(trials(), costs_of(given), asked=0.6, most=0.6)
    print_thresholds(table, given, "of a test")
    assert "Looking ended at 0.6" in capsys.readouterr().out
