"""Reports of conformance checks."""

from __future__ import annotations

from typing import ClassVar

from graspcast.io.conformance import Check, Report


class ToolReport(Report):
    kind: ClassVar[str] = "tool"


def test_a_report_passes_if_every_check_does() -> None:
    good, bad = Check("size", True, "12 mm"), Check("weight", False, "80 kg, expected 1")
    assert ToolReport("hammer", (good,)).passed
    assert ToolReport("hammer", (good,)).failures == ()
    report = ToolReport("hammer", (good, bad))
    assert not report.passed and report.failures == (bad,)
    assert str(report).splitlines() == [
        "tool hammer: FAILED",
        "  ok   size: 12 mm",
        "  FAIL weight: 80 kg, expected 1",
    ]
