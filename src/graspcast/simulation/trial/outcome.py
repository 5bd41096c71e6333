"""Outcome of a trial: success or failure, with its reason and what happened on the approach."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

__all__ = ["REASONS", "Outcome", "Reason"]

Reason = Literal["held", "dropped", "slipped", "missed", "collided", "blocked", "unstable"]
REASONS: tuple[Reason, ...] = (
    *("held", "dropped", "slipped", "missed", "collided", "blocked", "unstable"),
)


@dataclass(frozen=True)
class Outcome:
    """Outcome of a trial.

    Attributes
    ----------
    success
        Whether the object stayed within the tolerance of its place in the hand.
    reason
        ``held`` for a success. Failures: ``blocked``, the open hand would start in the object or
        the table, or, by the paper's protocol, end its approach in the object; ``collided``, the
        arm stopped on the approach, because the hand pressed against something or did not reach its
        goal; ``missed``, fewer than two parts of the closed hand touched the object, and none does
        at the end; ``dropped``, at least two did, but none at the end; ``slipped``, the hand
        touches the object at the end, but it has moved too far; ``unstable``, the simulation
        diverged.
    offset_m
        Distance between the object's centroid in the hand's base frame after closing and after the
        lift, metres. After early stopping: the distance at that time if the object is in the hand,
        the distance at the end of the full lift if it is left behind. NaN if blocked, collided or
        unstable.
    simulated_s
        Simulated time, seconds.
    computed_s
        Computing time, seconds; the only field that differs between equal trials.
    steps
        Number of simulation steps.
    short_m
        How far short of its goal the hand was at the end of the approach, or where it stopped,
        metres. NaN by the paper's protocol, which does not watch the approach, and if blocked.
    force_n
        Largest net force of contacts on the hand that lasted for ``contact_s`` of the approach,
        newtons; NaN as ``short_m``.
    hit
        What exerted the larger part of that force, ``"object"`` or ``"table"``; None if nothing.
    """

    success: bool
    reason: Reason
    offset_m: float
    simulated_s: float
    computed_s: float
    steps: int
    short_m: float = math.nan
    force_n: float = math.nan
    hit: Literal["object", "table"] | None = None

    @property
    def stop(self) -> str:
        """Where the hand stopped on the approach, and what it pressed, in words.

        For example ``"stopped 40 mm short, pressing the object with 62 N"``; empty unless collided.
        """
        if self.reason != "collided":
            return ""
        short = f"stopped {1e3 * self.short_m:.{0 if self.short_m >= 0.00995 else 1}f} mm short"
        return f"{short}, pressing the {self.hit} with {self.force_n:.0f} N" if self.hit else short
