"""Diagnostics: how the judging of messages goes, as ``diagnostic_msgs/DiagnosticArray``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from graspcast.ros.judging import StreamJudge
from graspcast.ros.outgoing import Maker
from graspcast.ros.poses import Stamp

__all__ = ["ERROR", "OK", "WARN", "Status", "diagnostic_array", "judging_status", "monitor_status"]

OK, WARN, ERROR = 0, 1, 2
_NS = 1_000_000_000


@dataclass(frozen=True)
class Status:
    """One part's state.

    Attributes
    ----------
    name
        Of the part.
    level
        ``OK``, ``WARN`` or ``ERROR``.
    message
        In a few words.
    values
        Figures.
    """

    name: str
    level: int
    message: str
    values: Mapping[str, str] = field(default_factory=dict)


def judging_status(judge: StreamJudge, before: Mapping[str, int]) -> Status:
    """Return the state of the judging.

    Parameters
    ----------
    judge
        What judges.
    before
        Its problems' counts at the last time; what is new since then is a warning.
    """
    counts = judge.problems.counts()
    new = [kind for kind, number in counts.items() if number > before.get(kind, 0)]
    values = {"frames": judge.frames, "judged": judge.judged, **counts}
    level, message = (WARN, "; ".join(new)) if new else (OK, "all that came was used")
    if judge.frames == 0:
        level, message = (WARN, message if new else "no estimates have come so far")
    return Status("judging", level, message, {k: str(v) for k, v in values.items()})


def monitor_status(alarm: bool, message: str) -> Status:
    """Return the state of the drift monitor: an alarm is an error until it is reset."""
    return Status("guarantee", ERROR if alarm else OK, message)


def diagnostic_array(
    make: Maker, statuses: Sequence[Status], now: Stamp, node: str, hardware: str = ""
) -> Any:
    """Return the ``DiagnosticArray`` of a node's parts."""
    stamp = make("builtin_interfaces/msg/Time", sec=now // _NS, nanosec=now % _NS)
    status = [
        make(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=bytes([part.level]),
            name=f"{node}: {part.name}",
            message=part.message,
            hardware_id=hardware,
            values=[
                make("diagnostic_msgs/msg/KeyValue", key=key, value=value)
                for key, value in part.values.items()
            ],
        )
        for part in statuses
    ]
    header = make("std_msgs/msg/Header", stamp=stamp, frame_id="")
    return make("diagnostic_msgs/msg/DiagnosticArray", header=header, status=status)
