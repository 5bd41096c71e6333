"""Progress of several steps as one share."""

from __future__ import annotations

from graspcast.io.progress import Count, step_of


def test_steps_share_the_range_from_0_to_1() -> None:
    heard: list[tuple[float, str]] = []

    def progress(share: float, message: str) -> None:
        heard.append((share, message))

    for i in range(2):
        step = step_of(progress, i, 2)
        step(0.5, f"half of {i}")
        step(1.0, "")
    step_of(progress, 1, 2, "all")(1.0, "hidden")
    assert heard == [(0.25, "half of 0"), (0.5, ""), (0.75, "half of 1"), (1.0, ""), (1.0, "all")]


def test_without_a_callback_nothing_happens() -> None:
    step_of(None, 0, 1)(0.5, "ignored")


def test_a_count_is_its_text() -> None:
    count = Count(1240, 5000, "trials", "loss 0.3")
    assert count == "1,240 of 5,000 trials, loss 0.3"
    assert (count.done, count.total, count.share) == (1240, 5000, 0.248)
    assert Count(0, 0, "trials").share == 1.0
    heard: list[str] = []
    step_of(lambda share, text: heard.append(text), 0, 2)(0.5, count)
    assert heard[0] is count
