"""What of a log is a trial of a policy; tests/cli/test_log_options.py compares with files."""

from __future__ import annotations

from collections import Counter

import polars as pl
import pytest

from graspcast.errors import MismatchError
from graspcast.evaluation.logged_certification import _final, _lowest_threshold, _trials


def decisions(*rows: tuple) -> pl.DataFrame:
    names = ["episode", "look", "instance", "action", "probability", "threshold", "success"]
    table = pl.DataFrame(rows, schema=names, orient="row")
    return table.with_columns(object_name=pl.lit("ycbv-5"))


def test_the_first_attempt_at_an_instance_is_its_trial_or_the_last_decision() -> None:
    table = decisions(
        ("e", 1, 0, "look again", 0.5, 0.8, None),
        ("e", 2, 0, "attempt", 0.9, 0.8, True),
        ("e", 3, 0, "attempt", 0.95, 0.8, False),
        ("e", 1, 1, "look again", 0.3, 0.8, None),
        ("e", 2, 1, "abstain", 0.2, 0.8, None),
    )
    found = _final(table).sort("instance")
    assert found["probability"].to_list() == [0.9, 0.2]


def test_thresholds_of_a_policy_with_looks_are_one() -> None:
    table = decisions(
        ("e", 1, 0, "attempt", 0.9, 0.8, True), ("f", 1, 0, "attempt", 0.9, 0.7, True)
    )
    assert _lowest_threshold(table, several=False) == 0.8
    with pytest.raises(MismatchError, match=r"the thresholds 0\.7, 0\.8"):
        _lowest_threshold(table, several=True)


def test_what_was_tried_below_the_largest_threshold_is_no_trial_from_there_on() -> None:
    table = decisions(
        ("e", 1, 0, "attempt", 0.75, 0.7, True),
        ("f", 1, 0, "attempt", 0.9, 0.8, True),
        ("g", 1, 0, "abstain", 0.9, 0.8, None),
        ("h", 1, 0, "attempt", 0.9, 0.8, None),
    )
    left: Counter[str] = Counter()
    trials = _trials(_final(table), 0.8, left)
    assert len(trials.instances) == 3
    assert (trials.probability >= 0.8).sum() == 1
    assert left == {"attempts without an outcome": 1}
