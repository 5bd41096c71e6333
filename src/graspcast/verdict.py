"""From a probability to a verdict: attempt the grasp, or abstain."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import dataclass
from operator import itemgetter
from os import PathLike

from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.estimates import Estimates
from graspcast.files import write_text

__all__ = ["Verdict", "VerdictRow", "check_threshold", "decide", "verdict_rows", "write_verdicts"]

COLUMNS = ("scene_id", "im_id", "obj_id", "gripper", "probability", "verdict", "reason")


@dataclass(frozen=True)
class Verdict:
    """Whether to attempt a grasp, and why.

    Attributes:
        attempt: Whether to attempt it.
        probability: Of success; None where there is no forecast.
        reason: Why, in a few words.
    """

    attempt: bool
    probability: float | None
    reason: str

    def __str__(self) -> str:
        return "attempt" if self.attempt else "abstain"


@dataclass(frozen=True)
class VerdictRow:
    """The verdict on one instance: BOP numbers, gripper, verdict."""

    scene_id: int
    im_id: int
    obj_id: int
    gripper: str
    verdict: Verdict


def check_threshold(threshold: float) -> float:
    """A decision threshold, if it is a probability.

    Raises:
        InputError: if it is not between 0 and 1.
    """
    if not 0.0 <= threshold <= 1.0:
        raise InputError(f"the threshold is a probability between 0 and 1, not {threshold}")
    return threshold


def decide(probability: float, threshold: float) -> Verdict:
    """Attempt at this probability or above it."""
    attempt = probability >= threshold
    sign = ">=" if attempt else "<"
    return Verdict(attempt, probability, f"probability {probability:.3f} {sign} {threshold:g}")


def verdict_rows(
    estimates: Estimates, probability: Float[ndarray, "n"], gripper: str, threshold: float
) -> list[VerdictRow]:
    """Verdicts on all of the anchor's instances, in the order of their numbers.

    Args:
        estimates: Instances with a pose by every estimator, and those that some lack.
        probability: Of success, for each instance.
        gripper: The gripper's name.
        threshold: Attempt at this probability or above it.
    """
    check_threshold(threshold)
    columns = (estimates.scene_id, estimates.im_id, estimates.obj_id, estimates.inst_id)
    keys = zip(*(column.tolist() for column in columns), strict=True)
    rows = [(k, decide(p, threshold)) for k, p in zip(keys, probability.tolist(), strict=True)]
    for gap in estimates.partial:
        verdict = Verdict(False, None, f"no estimate by {', '.join(gap.lacking)}")
        rows.append(((gap.scene_id, gap.im_id, gap.obj_id, gap.inst_id), verdict))
    rows.sort(key=itemgetter(0))
    return [VerdictRow(s, i, o, gripper, verdict) for (s, i, o, _), verdict in rows]


def write_verdicts(path: str | PathLike[str], rows: Iterable[VerdictRow]) -> None:
    """Write verdicts as CSV, whole or not at all; no probability is an empty field."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        given = row.verdict.probability
        writer.writerow(
            [
                row.scene_id,
                row.im_id,
                row.obj_id,
                row.gripper,
                "" if given is None else f"{given:.6f}",
                row.verdict,
                row.verdict.reason,
            ]
        )
    write_text(path, out.getvalue())
