"""From a probability to a verdict: attempt the grasp, or abstain."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import dataclass
from operator import itemgetter
from os import PathLike
from pathlib import Path

from graspcast.errors import FormatError, InputError
from graspcast.estimates.alignment import Estimates
from graspcast.io.files import write_text

__all__ = [
    "OOD_ALPHA",
    "Verdict",
    "VerdictRow",
    "check_threshold",
    "decide",
    "read_verdicts",
    "verdict_rows",
    "write_verdicts",
]

OOD_ALPHA = 0.01
"""A disagreement whose p-value is this or less is unfamiliar, so it is abstained from."""

COLUMNS = ("scene_id", "im_id", "obj_id", "gripper", "probability", "verdict", "reason")


@dataclass(frozen=True)
class Verdict:
    """Whether to attempt a grasp, and why.

    Attributes
    ----------
    attempt
        Whether to attempt it.
    probability
        Of success; None where there is no forecast.
    reason
        Why, in a few words.
    threshold
        The least probability that is attempted; None where there is no forecast.
    promise
        What the threshold was certified to keep, if it was.
    p_value
        How usual the disagreement is (small is strange), where that was asked.
    unfamiliar
        Whether it was too strange to trust the forecast.
    moved
        What moved the probability, and by how much, the strongest first, where asked.
    """

    attempt: bool
    probability: float | None
    reason: str
    threshold: float | None = None
    guarantee: str | None = None
    p_value: float | None = None
    out_of_distribution: bool = False
    attribution: tuple[tuple[str, float], ...] = ()

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

    Raises
    ------
    InputError
        If it is not between 0 and 1.
    """
    if not 0.0 <= threshold <= 1.0:
        raise InputError(f"the threshold is a probability between 0 and 1, not {threshold}")
    return threshold


def decide(
    probability: float,
    threshold: float | None,
    *,
    guarantee: str | None = None,
    p_value: float | None = None,
    ood_alpha: float = OOD_ALPHA,
    attribution: tuple[tuple[str, float], ...] = (),
) -> Verdict:
    """Attempt at this probability or above it, unless the disagreement is unfamiliar.

    Parameters
    ----------
    probability
        Of success.
    threshold
        The least that is attempted; None attempts nothing.
    promise
        What the threshold was certified to keep, or why nothing could be.
    p_value
        How usual the disagreement is; None is not asked.
    strange
        A p-value of this or less is unfamiliar; 0 trusts every forecast.
    moved
        What moved the probability.
    """
    out_of_distribution = p_value is not None and p_value <= ood_alpha
    attempt = threshold is not None and probability >= threshold and not out_of_distribution
    if threshold is None:
        reason = f"probability {probability:.3f}; no threshold could be certified"
    else:
        sign = ">=" if probability >= threshold else "<"
        reason = f"probability {probability:.3f} {sign} {threshold:g}"
    if out_of_distribution:
        reason += f"; unfamiliar disagreement (p-value {p_value:.4f})"
    if attribution:
        told = ", ".join(f"{name} {by:+.2f}" for name, by in attribution[:2])
        reason += f"; moved by {told}"
    return Verdict(
        attempt,
        probability,
        reason,
        threshold,
        guarantee,
        p_value,
        out_of_distribution,
        tuple(attribution),
    )


def verdict_rows(
    estimates: Estimates, verdicts: Iterable[Verdict], gripper: str
) -> list[tuple[tuple[int, int, int, int], VerdictRow]]:
    """Verdicts on all of the anchor's instances, by scene, image, object and instance, ascending.

    Parameters
    ----------
    estimates
        Instances with a pose by every estimator, and those that some lack.
    verdicts
        One for each of the former.
    gripper
        The gripper's name.
    """
    columns = (estimates.scene_id, estimates.im_id, estimates.obj_id, estimates.est_id)
    keys = zip(*(column.tolist() for column in columns), strict=True)
    rows = list(zip(keys, verdicts, strict=True))
    for gap in estimates.partial:
        verdict = Verdict(False, None, f"no estimate by {', '.join(gap.lacking)}")
        rows.append(((gap.scene_id, gap.im_id, gap.obj_id, gap.est_id), verdict))
    rows.sort(key=itemgetter(0))
    return [(key, VerdictRow(key[0], key[1], key[2], gripper, given)) for key, given in rows]


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


def read_verdicts(path: str | PathLike[str]) -> list[VerdictRow]:
    """Read what :func:`write_verdicts` wrote, in its order.

    Raises
    ------
    FormatError
        Naming the line.
    """
    try:
        with Path(path).open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.DictReader(stream)
            missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
            if missing:
                raise FormatError(
                    path, f"no column {', '.join(missing)}; is it what graspcast predict wrote?"
                )
            return [_verdict_row(row, path, f"line {reader.line_num}") for row in reader]
    except OSError as error:
        raise FormatError(path, f"cannot be read ({error.strerror})") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise FormatError(path, f"is not a CSV file ({error})") from error


def _verdict_row(row: dict[str, str], path: str | PathLike[str], where: str) -> VerdictRow:
    if None in row.values() or None in row:
        raise FormatError(path, f"should have {len(COLUMNS)} fields", where=where)
    said = {"attempt": True, "abstain": False}.get(row["verdict"])
    if said is None:
        raise FormatError(
            path, f"the verdict is {row['verdict']!r}, not attempt or abstain", where=where
        )
    try:
        probability = float(row["probability"]) if row["probability"] else None
    except ValueError:
        probability = float("nan")
    if probability is not None and not 0.0 <= probability <= 1.0:
        raise FormatError(
            path, f"the probability is {row['probability']}, not from 0 to 1", where=where
        )
    scene_id, im_id, obj_id = (_number(row[name], name, path, where) for name in COLUMNS[:3])
    verdict = Verdict(said, probability, row["reason"])
    return VerdictRow(scene_id, im_id, obj_id, row["gripper"], verdict)


def _number(text: str, name: str, path: str | PathLike[str], where: str) -> int:
    if not text.isdecimal() or int(text) >= 2**31:
        raise FormatError(path, f"{name} is {text!r}, not a BOP number", where=where)
    return int(text)
