"""Time left, in words."""

from __future__ import annotations

import pytest

from graspcast.training import pace
from graspcast.training.pace import Pace, in_words


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(12.4, "12 s"), (99, "99 s"), (720, "12 min"), (12_000, "3 h 20 min"), (7200, "2 h 0 min")],
)
def test_durations_in_words(seconds: float, words: str) -> None:
    assert in_words(seconds) == words


def test_what_was_done_before_does_not_count_as_fast(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(pace.time, "monotonic", lambda: now[0])
    mine = Pace(0.5)
    assert mine.left(0.5) == ""
    now[0] += 10
    assert mine.left(0.6) == "40 s left"
