"""What ``certify`` prints of promises: lower rates, confidences, and alternatives."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from graspcast.cli.console import print_table
from graspcast.io.wording import counted

if TYPE_CHECKING:
    from graspcast.guarantees.certificate import Certificate
    from graspcast.guarantees.promises import Promise

__all__ = ["confidence_of", "print_alternatives", "promised", "rate_of"]


_LEAST = 0.001


def rate_of(promise: Promise | None) -> str:
    """Return a promised rate in three digits, rounded down; a dash without one."""
    return "-" if promise is None else _down(promise.rate)


def confidence_of(value: float) -> str:
    """Return a confidence in three digits, rounded down."""
    return _down(value)


def _down(value: float) -> str:
    return f"{math.floor(value * 1000 + 1e-9) / 1000:.3f}"


def print_alternatives(certificate: Certificate) -> None:
    """Print what would have been promised, had something else been asked for beforehand."""
    if not certificate.alternatives:
        return
    overall = certificate.overall
    rate = overall.rate if overall.asked_rate is None else overall.asked_rate
    title = (
        f"Had it been asked for beforehand (no promises: choosing among these by the data would "
        f"not keep the confidence of {overall.confidence:g})"
    )
    header = ["instead", "units", f"threshold for {rate:g}", "highest rate", "at threshold"]
    header += [f"highest confidence for {rate:g}", "units needed"]
    rows = []
    for other in certificate.alternatives:
        needed = "> 10,000" if other.needed_units is None else str(other.needed_units)
        rows.append(
            [
                other.name,
                counted(other.units, other.unit),
                "none" if other.threshold is None else f"{other.threshold:.3f}",
                rate_of(other.best),
                "-" if other.best is None else f"{other.best.threshold:.3f}",
                confidence_of(other.possible_confidence),
                "-" if other.threshold is not None else needed,
            ]
        )
    print_table(title, header, rows)


def promised(certificate: Certificate, unit: str) -> str:
    """Say what the data promise for all objects, and what would give more: units, not trials."""
    guarantee = certificate.overall
    confidence = f"{guarantee.confidence:g}"
    rate = guarantee.rate if guarantee.asked_rate is None else guarantee.asked_rate
    most = guarantee.possible_confidence or 0.0
    units = counted(guarantee.units, unit)
    if guarantee.threshold is not None and not guarantee.is_lower:
        best = guarantee.best
        text = f"What was asked for is promised. Had it been asked for beforehand, these {units} "
        if best is not None and best.rate > rate:
            text += (
                f"would have promised a rate of {_down(best.rate)} (at {best.threshold:.3g} or "
                "above), or "
            )
        return f"{text}would have promised {rate:g} with confidence {_down(most)}."
    lines = []
    if guarantee.is_lower:
        lines.append(
            f"The rate of {rate:g} that was asked for cannot be promised from these {units}. "
            f"Accepted, and promised with confidence {confidence}: {_down(guarantee.rate)}."
        )
    elif (lower := guarantee.lower) is not None:
        lines.append(
            f"Promised with confidence {confidence}: a success rate of {_down(lower.rate)}, at "
            f"probability {lower.threshold:.3g} or above ({lower.drawn_successes} of "
            f"{counted(lower.drawn_attempts, 'drawn attempt')} succeeded). --accept-lower makes "
            "it the certificate's; until then nothing is attempted by it."
        )
    else:
        lines.append(f"With confidence {confidence}, no rate above 0 can be promised.")
    if guarantee.limit < rate:
        lines.append(
            f"From {units} no rate above {_down(guarantee.limit)} can be promised with confidence "
            f"{confidence}, even if every grasp succeeds."
        )
    had = (
        f"it would have been promised with confidence {_down(most)} at most, had that been asked "
        "for beforehand"
        if most >= _LEAST
        else "no confidence worth asking for would have been enough"
    )
    lines.append(f"As to the rate of {rate:g}, {had}.")
    if guarantee.needed_units is not None:
        lines.append(
            f"The cheapest way to {rate:g}: {counted(guarantee.needed_units, f'new {unit}')}, if "
            f"the success rate seen above {guarantee.reported_threshold:.3g} continues; more "
            f"grasps in the same {unit}s do not replace them."
        )
    fewest = min(
        (other for other in certificate.alternatives if other.needed_units is not None),
        key=lambda other: other.needed_units or 0,
        default=None,
    )
    if fewest is not None and (fewest.needed_units or 0) < (guarantee.needed_units or math.inf):
        lines.append(
            f"Fewer would do for another guarantee, if it is asked for beforehand: {fewest.name}, "
            f"{counted(fewest.needed_units or 0, f'new {fewest.unit}')}."
        )
    return "\n".join(lines)
