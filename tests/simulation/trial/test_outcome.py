from __future__ import annotations

from typing import get_args

import pytest

from graspcast.simulation.trial.outcome import REASONS, Outcome, Reason


def collided(short_m: float, force_n: float, hit: object) -> Outcome:
    return Outcome(False, "collided", float("nan"), 0.1, 0.0, 50, short_m, force_n, hit)  # type: ignore[arg-type]


def test_every_reason_is_listed_once() -> None:
    assert get_args(Reason) == REASONS


@pytest.mark.parametrize(
    ("outcome", "words"),
    [
        (collided(0.04, 62.4, "object"), "stopped 40 mm short, pressing the object with 62 N"),
        (collided(0.0004, 41.0, "table"), "stopped 0.4 mm short, pressing the table with 41 N"),
        (collided(0.012, 0.0, None), "stopped 12 mm short"),
        (Outcome(True, "held", 0.001, 1.0, 0.0, 500), ""),
    ],
)
def test_a_stop_is_told_in_words(outcome: Outcome, words: str) -> None:
    assert outcome.stop == words
