"""Rate and time left, in words."""

from __future__ import annotations

import pytest

from graspcast.cli import pace
from graspcast.cli.pace import Pace, in_words
from graspcast.io.progress import Count


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A clock that stands until a test moves it."""
    now = [100.0]
    monkeypatch.setattr(pace.time, "monotonic", lambda: now[0])
    return now


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (12.4, "12 s"),
        (99.0, "99 s"),
        (720.0, "12 min"),
        (12e3, "3 h 20 min"),
        (7200.0, "2 h 0 min"),
    ],
)
def test_durations_in_words(seconds: float, words: str) -> None:
    assert in_words(seconds) == words


def test_what_was_done_before_does_not_count_as_fast(now: list[float]) -> None:
    mine = Pace()
    assert mine.left() == "" and mine.rate() == ""
    now[0] += 50  # what comes before the first report is not the work's pace
    mine.report(0.5, Count(500, 1000, "trials"))
    assert mine.left() == "" and mine.rate() == ""
    now[0] += 10
    mine.report(0.6, Count(600, 1000, "trials"))
    assert mine.left() == "40 s left" and mine.rate() == "10/s"


def test_other_work_is_measured_anew(now: list[float]) -> None:
    mine = Pace()
    mine.report(0.0, "first")
    now[0] += 10
    mine.report(0.9, "first")
    assert mine.left() == "1 s left"
    mine.report(0.0, "second")  # the share has fallen
    assert mine.left() == ""
    now[0] += 10
    mine.report(0.1, "second")
    assert mine.left() == "90 s left"
    mine.report(0.2, Count(2, 10, "images"))  # something else is counted
    assert mine.left() == ""


@pytest.mark.parametrize(
    ("done", "rate"), [(5_000, "500/s"), (100, "10/s"), (15, "1.5/s"), (2, "12.0/min")]
)
def test_rates(now: list[float], done: int, rate: str) -> None:
    mine = Pace()
    mine.report(0.0, Count(0, 10_000, "things"))
    now[0] += 10
    mine.report(done / 10_000, Count(done, 10_000, "things"))
    assert mine.rate() == rate
