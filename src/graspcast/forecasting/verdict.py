"""Verdicts: attempt a grasp or abstain, and the CSV file of them."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.units import metres, millimetres
from graspcast.errors import FormatError, InputError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.instances import KEY_COLUMNS, InstanceKey
from graspcast.estimates.outcomes import REFERENCE_GRASP
from graspcast.forecasting.novelty import OOD_ALPHA, Disagreement
from graspcast.io.arguments import PATH, a, checked, number, refuse_unless, sequence
from graspcast.io.files import write_text
from graspcast.io.reading import read_text
from graspcast.pose.transforms import transform

__all__ = [
    "Verdict",
    "VerdictRow",
    "check_threshold",
    "decide",
    "read_verdicts",
    "verdict_rows",
    "write_verdicts",
]

_is_share, _ = number(0.0, 1.0)
_NUMBERS = ("scene_id", "im_id", "obj_id", "est_id")
_NAMES = ("dataset", "principal", "gripper", "grasp")
COLUMNS = (
    *KEY_COLUMNS,
    "principal",
    "gripper",
    "grasp",
    "probability",
    "verdict",
    "reason",
    "R",
    "t",
)
"""The columns of a verdicts file; ``R`` (row by row) and ``t`` (mm) are BOP's, of ``cam_T_obj``."""


@dataclass(frozen=True)
class Verdict:
    """Whether to attempt a grasp, and why.

    Attributes
    ----------
    attempt
        Whether to attempt it.
    probability
        The probability of success; None where there is no forecast.
    reason
        Why, in a few words.
    threshold
        The least probability that is attempted; None where there is no forecast.
    guarantee
        What the threshold was certified to keep, if it was.
    p_value
        Conformal p-value of the disagreement under the training data; None where not asked for.
    out_of_distribution
        Whether the disagreement is too unusual to trust the forecast; None where the training data
        are too few to tell, and no disagreement is larger than in training.
    attribution
        Groups of features and by how much each moved the probability, the strongest first; empty
        where not asked for.
    """

    attempt: bool
    probability: float | None
    reason: str
    threshold: float | None = None
    guarantee: str | None = None
    p_value: float | None = None
    out_of_distribution: bool | None = False
    attribution: tuple[tuple[str, float], ...] = ()

    def __str__(self) -> str:
        return "attempt" if self.attempt else "abstain"


@dataclass(frozen=True, eq=False)
class VerdictRow:
    """The verdict on one grasp of one instance.

    Attributes
    ----------
    key
        The instance; ``est_id`` is the principal's.
    principal, gripper, grasp
        Who guides which grasp by which gripper.
    verdict
        Attempt or abstain, and why.
    cam_T_obj
        The principal's pose, which would guide the grasp, metres, (4, 4).
    views
        From how many images the forecast is.
    """

    key: InstanceKey
    principal: str
    gripper: str
    verdict: Verdict
    cam_T_obj: Float[ndarray, "4 4"]
    grasp: str = REFERENCE_GRASP
    views: int = 1

    def __repr__(self) -> str:
        return f"VerdictRow({self.key} by {self.principal}, {self.gripper} gripper: {self.verdict})"


def check_threshold(threshold: float) -> float:
    """Return a decision threshold, if it is a probability.

    Raises
    ------
    InputError
        If it is not between 0 and 1.
    """
    if not _is_share(threshold):
        raise InputError(f"the threshold is a probability between 0 and 1, not {threshold}")
    return threshold


def decide(
    probability: float,
    threshold: float | None,
    *,
    guarantee: str | None = None,
    disagreement: Disagreement | None = None,
    ood_alpha: float = OOD_ALPHA,
    attribution: tuple[tuple[str, float], ...] = (),
) -> Verdict:
    """Return the verdict: attempt from a probability on, unless out of distribution.

    Parameters
    ----------
    probability
        The probability of success.
    threshold
        The least that is attempted; None attempts nothing.
    guarantee
        What the threshold was certified to keep, or why nothing could be.
    disagreement
        How unusual the estimators' disagreement is; None if not asked for.
    ood_alpha
        A p-value of this or less is out of distribution; 0 accepts every p-value. A disagreement
        larger than in training is always out of distribution.
    attribution
        What moved the probability, and by how much.
    """
    unusual = None if disagreement is None else disagreement.is_novel(ood_alpha)
    p_value = None if disagreement is None else disagreement.p_value
    attempt = threshold is not None and probability >= threshold and not unusual
    if threshold is None:
        reason = f"probability {probability:.3f}; no threshold could be certified"
    else:
        sign = ">=" if probability >= threshold else "<"
        reason = f"probability {probability:.3f} {sign} {threshold:g}"
    if disagreement is not None and unusual:
        why = disagreement.excess or f"p-value {disagreement.p_value:.4f}"
        reason += f"; out-of-distribution disagreement ({why})"
    elif disagreement is not None and unusual is None:
        reason += (
            f"; novelty not checkable at level {ood_alpha:g} (smallest p-value "
            f"{disagreement.smallest:.3f})"
        )
    if attribution:
        parts = ", ".join(f"{name} {by:+.2f}" for name, by in attribution[:2])
        reason += f"; attributed to {parts}"
    return Verdict(
        attempt,
        probability,
        reason,
        threshold,
        guarantee,
        p_value,
        False if disagreement is None else unusual,
        tuple(attribution),
    )


def verdict_rows(
    estimates: Estimates,
    verdicts: Iterable[Verdict],
    *,
    principal: str,
    gripper: str,
    grasp: str = REFERENCE_GRASP,
) -> list[VerdictRow]:
    """Return the verdicts on all of the principal's instances, ordered by key.

    Parameters
    ----------
    estimates
        Instances with a pose by every estimator, and those that some lack: these are abstained
        from.
    verdicts
        One for each of the former.
    principal, gripper, grasp
        Who guides which grasp by which gripper.
    """
    who: dict[str, Any] = {"principal": principal, "gripper": gripper, "grasp": grasp}
    triples = zip(estimates.instances.to_keys(), verdicts, estimates.of(principal), strict=True)
    rows = [VerdictRow(key, verdict=given, cam_T_obj=pose, **who) for key, given, pose in triples]
    for gap in estimates.incomplete:
        verdict = Verdict(False, None, gap.reason)
        rows.append(VerdictRow(gap.key, verdict=verdict, cam_T_obj=gap.cam_T_obj, **who))
    return sorted(rows, key=lambda row: row.key)


@checked(path=PATH)
def write_verdicts(path: str | PathLike[str], rows: Iterable[VerdictRow]) -> None:
    """Write verdicts as CSV, atomically; no probability is an empty field."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    rows = list(rows) if isinstance(rows, Iterable) else rows
    refuse_unless(sequence(a(VerdictRow)), rows, "write_verdicts", "rows")
    poses = np.stack([row.cam_T_obj for row in rows]) if rows else np.empty((0, 4, 4))
    R, t = poses[:, :3, :3].reshape(-1, 9).tolist(), millimetres(poses[:, :3, 3]).tolist()
    for i, row in enumerate(rows):
        given = row.verdict.probability
        writer.writerow(
            [
                *row.key,
                row.principal,
                row.gripper,
                row.grasp,
                "" if given is None else f"{given:.6f}",
                row.verdict,
                row.verdict.reason,
                " ".join(map(repr, R[i])),
                " ".join(map(repr, t[i])),
            ]
        )
    write_text(path, out.getvalue())


@checked(path=PATH)
def read_verdicts(path: str | PathLike[str]) -> list[VerdictRow]:
    """Read what :func:`write_verdicts` wrote, in the order of the file.

    Raises
    ------
    FormatError
        Naming the line; for a file of a former version, which names no instance; and for two
        verdicts on the same grasp.
    """
    try:
        with io.StringIO(read_text(path), newline="") as stream:
            reader = csv.DictReader(stream)
            _check_columns(path, reader.fieldnames or ())
            lines: dict[tuple[object, ...], int] = {}
            out = []
            for row in reader:
                found = _verdict_row(row, path, f"line {reader.line_num}")
                trial = (found.key, found.principal, found.gripper, found.grasp)
                if trial in lines:
                    raise FormatError(
                        path,
                        f"line {lines[trial]} holds a verdict on the same grasp: {found.key}",
                        where=f"line {reader.line_num}",
                    )
                lines[trial] = reader.line_num
                out.append(found)
            return out
    except csv.Error as error:
        raise FormatError(path, f"is not a CSV file ({error})") from error


def _check_columns(path: str | PathLike[str], columns: Sequence[str]) -> None:
    missing = [name for name in COLUMNS if name not in columns]
    if not missing:
        return
    if "verdict" in columns and "est_id" in missing:
        raise FormatError(
            path,
            "is a verdicts file of a former version, which does not say which instance a row is "
            "about; run graspcast predict again",
        )
    raise FormatError(
        path, f"no column {', '.join(missing)}; a verdicts file has {', '.join(COLUMNS)}"
    )


def _verdict_row(row: dict[str, str], path: str | PathLike[str], where: str) -> VerdictRow:
    if None in row.values() or None in row:
        raise FormatError(path, f"should have {len(COLUMNS)} fields", where=where)
    attempt = {"attempt": True, "abstain": False}.get(row["verdict"])
    if attempt is None:
        raise FormatError(
            path, f"the verdict is {row['verdict']!r}, not attempt or abstain", where=where
        )
    for name in _NAMES:
        if not row[name]:
            raise FormatError(path, f"{name} is empty", where=where)
    try:
        probability = float(row["probability"]) if row["probability"] else None
    except ValueError:
        probability = float("nan")
    if probability is not None and not 0.0 <= probability <= 1.0:
        raise FormatError(
            path, f"the probability is {row['probability']}, not from 0 to 1", where=where
        )
    numbers = (_number(row[name], name, path, where) for name in _NUMBERS)
    return VerdictRow(
        key=InstanceKey(row["dataset"], *numbers),
        principal=row["principal"],
        gripper=row["gripper"],
        grasp=row["grasp"],
        verdict=Verdict(attempt, probability, row["reason"]),
        cam_T_obj=transform(
            _numbers(row["R"], 9, "R", path, where).reshape(3, 3),
            metres(_numbers(row["t"], 3, "t", path, where)),
        ),
    )


def _number(text: str, name: str, path: str | PathLike[str], where: str) -> int:
    if not text.isdecimal() or len(text) > 10 or int(text) >= 2**31:
        raise FormatError(path, f"{name} is {text!r}, not a BOP number", where=where)
    return int(text)


def _numbers(
    text: str, count: int, name: str, path: str | PathLike[str], where: str
) -> Float[ndarray, " count"]:
    try:
        values = np.array(text.split(), dtype=np.float64)
    except ValueError:
        values = np.empty(0)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise FormatError(path, f"{name} is not {count} finite numbers: {text!r}", where=where)
    return values
