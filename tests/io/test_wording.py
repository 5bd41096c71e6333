"""Numbers of things in messages."""

from __future__ import annotations

from graspcast.io.wording import counted


def test_one_thing_is_no_plural() -> None:
    assert counted(1, "instance") == "1 instance"
    assert counted(0, "instance") == "0 instances"
    assert counted(2, "view", "has", "have") == "2 views have"
    assert counted(1, "view", "has", "have") == "1 view has"
