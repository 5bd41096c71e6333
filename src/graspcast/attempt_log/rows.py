"""Rows of the attempt log: records as the values that are stored, and the digests of these."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from hashlib import sha256
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.attempt_log.records import DecisionRecord, FrameRecord, OutcomeRecord
from graspcast.errors import InputError

__all__ = [
    "DECISION_COLUMNS",
    "ESTIMATE_COLUMNS",
    "FIRST_CHAIN",
    "FRAME_COLUMNS",
    "FrameRows",
    "chained",
    "digest_of",
    "matrix",
    "outcome_row",
    "rows_of",
    "utc_text",
]

FRAME_COLUMNS = (
    "episode",
    "look",
    "time_utc",
    "world_T_cam",
    "K",
    "estimators",
    "model",
    "certificate",
    "source",
)
"""The columns of a frame that its digest is of."""
ESTIMATE_COLUMNS = ("estimator", "number", "object_name", "cam_T_obj", "score")
"""Likewise of its estimates, ordered by estimator and number."""
DECISION_COLUMNS = (
    "id",
    "instance",
    "object_name",
    "action",
    "probability",
    "threshold",
    "guarantee",
    "reason",
    "guide",
    "cam_T_obj",
    "world_T_obj",
    "gripper",
    "grasp",
    "views",
    "looks",
    "model",
    "certificate",
)
"""Likewise of its decisions, in order."""

FIRST_CHAIN = bytes(32)
"""What stands before the first chain of a table."""

Row = tuple[Any, ...]


@dataclass(frozen=True)
class FrameRows:
    """The rows of one frame, without the numbers that the log gives them.

    Attributes
    ----------
    frame, estimates, decisions
        Values in the order of the columns.
    digest
        SHA-256 of them all.
    """

    frame: Row
    estimates: list[Row]
    decisions: list[Row]
    digest: bytes


def rows_of(record: FrameRecord) -> FrameRows:
    """Return the rows of a frame."""
    frame = (
        record.episode,
        record.look,
        utc_text(record.time_utc),
        _blob(record.world_T_cam),
        _blob(record.K),
        json.dumps(list(record.estimates)),
        record.model,
        record.certificate,
        record.source,
    )
    estimates = [
        (estimator, number, name, _blob(pose), score)
        for estimator in sorted(record.estimates)
        for number, (name, pose, score) in enumerate(record.estimates[estimator])
    ]
    decisions = [_decision_row(decision, record) for decision in record.decisions]
    return FrameRows(frame, estimates, decisions, digest_of(frame, *estimates, *decisions))


def outcome_row(record: OutcomeRecord) -> Row:
    """Return ``success, reason, time_utc`` as they are stored."""
    return int(record.success), record.reason, utc_text(record.time_utc)


def digest_of(*rows: Sequence[Any]) -> bytes:
    """Return the SHA-256 of stored values."""
    plain = [[v.hex() if isinstance(v, bytes) else v for v in row] for row in rows]
    return sha256(json.dumps(plain, allow_nan=False).encode()).digest()


def chained(before: bytes, digest: bytes) -> bytes:
    """Return the chain after a row of this digest."""
    return sha256(before + digest).digest()


def matrix(blob: bytes | None) -> Float[ndarray, "n n"] | None:
    """Return a stored matrix, 4x4 or 3x3."""
    if blob is None:
        return None
    size = {128: 4, 72: 3}.get(len(blob))
    if size is None:
        raise InputError(f"a stored matrix has {len(blob)} bytes: the log is damaged, check it")
    return np.frombuffer(blob, dtype="<f8").astype(np.float64).reshape(size, size)


def utc_text(time: datetime | None) -> str:
    """Return a time as it is stored: ISO 8601, UTC, microseconds."""
    time = datetime.now(UTC) if time is None else time
    return time.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ").rjust(27, "0")


def _blob(array: ndarray | None) -> bytes | None:
    return None if array is None else array.astype("<f8").tobytes()


def _decision_row(decision: DecisionRecord, frame: FrameRecord) -> Row:
    values = [getattr(decision, name) for name in DECISION_COLUMNS]
    values = [_blob(v) if isinstance(v, ndarray) else v for v in values]
    values[-2] = frame.model if decision.model is None else decision.model
    values[-1] = frame.certificate if decision.certificate is None else decision.certificate
    return tuple(values)
