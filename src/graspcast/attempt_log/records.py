"""Records of the attempt log: frames with their decisions, and outcomes, as plain values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError

__all__ = ["ACTIONS", "DecisionRecord", "FrameRecord", "OutcomeRecord"]

ACTIONS = ("attempt", "look again", "abstain")
"""What a decision may be."""
_LONGEST = 10_000
_LARGEST = 2**62


@dataclass(frozen=True, eq=False)
class DecisionRecord:
    """What was decided about one instance.

    Attributes
    ----------
    id
        Unique among all decisions; outcomes name it.
    instance
        A number that stays the same from look to look of an episode.
    object_name
        ``dataset-obj_id``.
    action
        One of :data:`ACTIONS`.
    probability, threshold
        Of success, and the least that is attempted; None where there is no forecast.
    guarantee
        What the threshold was certified to keep, in words, or None.
    reason
        Why, in a few words.
    guide
        Whose pose guides the grasp: an estimator, or ``fused``; None without a pose.
    cam_T_obj, world_T_obj
        The object's pose by the guide, metres, (4, 4), or None.
    gripper, grasp
        Names of the gripper and of the grasp that was judged.
    views, looks
        How many looks entered the forecast, and how many the episode has.
    model, certificate
        Digests, where they are others than the frame's, or None.

    Raises
    ------
    InputError
        For a value of another kind or out of range.
    """

    id: str
    instance: int
    object_name: str
    action: str
    probability: float | None
    threshold: float | None
    guarantee: str | None
    reason: str
    guide: str | None
    cam_T_obj: Float[ndarray, "4 4"] | None
    world_T_obj: Float[ndarray, "4 4"] | None
    gripper: str
    grasp: str
    views: int
    looks: int
    model: str | None = None
    certificate: str | None = None

    def __post_init__(self) -> None:
        for name in ("id", "object_name", "gripper", "grasp"):
            _text(self, name)
        _text(self, "reason", empty=True)
        for name in ("guarantee", "guide", "model", "certificate"):
            _text(self, name, none=True)
        if self.action not in ACTIONS:
            raise InputError(
                f"DecisionRecord: action is {self.action!r}, not one of {', '.join(ACTIONS)}"
            )
        for name, least in (("instance", -_LARGEST), ("views", 0), ("looks", 0)):
            _whole(self, name, least)
        for name in ("probability", "threshold"):
            _number(self, name, 0.0, 1.0 if name == "probability" else math.inf)
        for name in ("cam_T_obj", "world_T_obj"):
            _matrix(self, name, (4, 4))


@dataclass(frozen=True, eq=False)
class FrameRecord:
    """All that the estimators found in one image, and what was decided on it.

    Attributes
    ----------
    episode
        The episode's id; the looks of one episode are of one scene that stands still.
    look
        Which look of the episode it is, from 1.
    estimates
        Estimator's name to (object name, ``cam_T_obj`` in metres (4, 4), score) of all it found.
    decisions
        One for each instance.
    world_T_cam
        The camera's pose in the world, metres, (4, 4), or None.
    K
        Intrinsics, pixels, (3, 3), or None.
    model, certificate
        SHA-256 digests of the model that judged and of the certificate of its threshold, or None.
    source
        Who writes: ``api``, ``service``, ``node``.
    time_utc
        When it was, with its time zone; now if None. It is information: the log's order is its own.

    Raises
    ------
    InputError
        For a value of another kind or out of range, or two decisions of one id.
    """

    episode: str
    look: int
    estimates: Mapping[str, Sequence[tuple[str, Any, float]]]
    decisions: Sequence[DecisionRecord]
    world_T_cam: Float[ndarray, "4 4"] | None = None
    K: Float[ndarray, "3 3"] | None = None
    model: str | None = None
    certificate: str | None = None
    source: str = "api"
    time_utc: datetime | None = None

    def __post_init__(self) -> None:
        _text(self, "episode")
        _text(self, "source")
        for name in ("model", "certificate"):
            _text(self, name, none=True)
        _whole(self, "look", 1)
        _matrix(self, "world_T_cam", (4, 4))
        _matrix(self, "K", (3, 3))
        _time(self)
        object.__setattr__(self, "estimates", _estimates(self.estimates))
        decisions = tuple(self.decisions) if isinstance(self.decisions, Sequence) else None
        if decisions is None or not all(isinstance(d, DecisionRecord) for d in decisions):
            raise InputError("FrameRecord: decisions should be a sequence of DecisionRecord")
        if len({d.id for d in decisions}) < len(decisions):
            raise InputError("FrameRecord: two of its decisions have the same id")
        object.__setattr__(self, "decisions", decisions)


@dataclass(frozen=True)
class OutcomeRecord:
    """What came of an attempt.

    Attributes
    ----------
    decision_id
        The decision whose grasp was tried.
    success
        Whether the grasp held.
    reason
        How it failed, or whatever else is to be known; or None.
    time_utc
        When it was, with its time zone; now if None.

    Raises
    ------
    InputError
        For a value of another kind.
    """

    decision_id: str
    success: bool
    reason: str | None = None
    time_utc: datetime | None = None

    def __post_init__(self) -> None:
        _text(self, "decision_id")
        _text(self, "reason", none=True, empty=True)
        if not isinstance(self.success, bool | np.bool_):
            raise InputError(
                f"OutcomeRecord: success should be True or False, not {self.success!r}",
                parameters=("success",),
            )
        object.__setattr__(self, "success", bool(self.success))
        _time(self)


def _text(record: Any, name: str, *, none: bool = False, empty: bool = False) -> None:
    value = getattr(record, name)
    if value is None and none:
        return
    problem = ""
    if not isinstance(value, str):
        problem = f"should be text, not {value!r:.50}"
    elif not value and not empty:
        problem = "is empty"
    elif len(value) > _LONGEST:
        problem = f"has {len(value):,} characters; at most {_LONGEST:,}"
    elif not _encodable(value):
        problem = "is no valid Unicode text"
    if problem:
        raise InputError(f"{type(record).__name__}: {name} {problem}", parameters=(name,))


def _encodable(value: str) -> bool:
    try:
        value.encode()
    except UnicodeEncodeError:
        return False
    return "\0" not in value


def _whole(record: Any, name: str, least: int) -> None:
    value = getattr(record, name)
    kind = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not kind or not least <= value <= _LARGEST:
        at_least = "" if least < 0 else f" of at least {least}"
        raise InputError(
            f"{type(record).__name__}: {name} should be a whole number{at_least}, not {value!r:.50}"
        )
    object.__setattr__(record, name, int(value))


def _number(record: Any, name: str, low: float, high: float) -> None:
    value = getattr(record, name)
    if value is None:
        return
    kind = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not kind or not math.isfinite(value) or not low <= value <= high:
        within = f"from {low:g} to {high:g}" if math.isfinite(high) else f"of at least {low:g}"
        raise InputError(
            f"{type(record).__name__}: {name} should be a number {within}, or None, not "
            f"{value!r:.50}"
        )
    object.__setattr__(record, name, float(value))


def _matrix(record: Any, name: str, shape: tuple[int, int]) -> None:
    value = getattr(record, name)
    if value is not None:
        array = _array(value, shape)
        if array is None or not np.isfinite(array).all():
            raise InputError(
                f"{type(record).__name__}: {name} should be a {shape[0]}x{shape[1]} matrix of "
                "finite numbers, or None",
                parameters=(name,),
            )
        object.__setattr__(record, name, array)


def _array(value: Any, shape: tuple[int, int]) -> ndarray | None:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    return array if array.shape == shape else None


def _time(record: Any) -> None:
    value = record.time_utc
    if value is None:
        value = datetime.now(UTC)
    if not isinstance(value, datetime) or value.tzinfo is None:
        raise InputError(
            f"{type(record).__name__}: time_utc should be a datetime with a time zone, or None, "
            f"not {value!r:.50}",
            parameters=("time_utc",),
        )
    object.__setattr__(record, "time_utc", value.astimezone(UTC))


def _estimates(given: Any) -> dict[str, tuple[tuple[str, ndarray, float], ...]]:
    """Return checked estimates; a pose that cannot be one is kept as it came."""
    if not isinstance(given, Mapping):
        raise InputError("FrameRecord: estimates should map names of estimators to their estimates")
    out = {}
    for estimator, found in given.items():
        if not isinstance(estimator, str) or not estimator or not _encodable(estimator):
            raise InputError(f"FrameRecord: {estimator!r:.50} is no name of an estimator")
        try:
            out[estimator] = tuple(_estimate(*each) for each in found)
        except (TypeError, ValueError) as error:
            raise InputError(
                f"FrameRecord: the estimates by {estimator} should be triples of an object's name, "
                "a 4x4 pose and a finite score"
            ) from error
    return out


def _estimate(object_name: str, cam_T_obj: Any, score: float) -> tuple[str, ndarray, float]:
    pose, number = _array(cam_T_obj, (4, 4)), float(score)
    named = isinstance(object_name, str) and object_name and _encodable(object_name)
    if not named or pose is None or not math.isfinite(number):
        raise ValueError
    return object_name, pose, number
