"""Verdicts against outcomes: what is gained by following them, and how many grasps it costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import polars as pl

from graspcast.errors import InputError, UnknownNameError
from graspcast.evaluation.bootstrap import Interval, every_scene_and_draws
from graspcast.forecasting.verdict import VerdictRow

__all__ = ["VerdictScores", "score_verdicts", "verdict_table", "with_outcomes"]

_KEYS = ("scene_id", "im_id", "obj_id", "est_id", "gripper")


@dataclass(frozen=True)
class VerdictScores:
    """What came of the grasps that verdicts are about.

    Attributes
    ----------
    n, attempts, scenes
        Verdicts with an outcome, those that attempt, and their scenes.
    untried
        Verdicts without an outcome.
    always
        Success rate if all are attempted.
    following
        Success rate of those that are attempted; None if there are none.
    attempt_rate
        Share that is attempted.
    gain
        By how much following is better than always, under the same draws of scenes.
    """

    n: int
    attempts: int
    scenes: int
    untried: int
    always: Interval
    following: Interval | None
    attempt_rate: Interval
    gain: Interval | None

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers, for JSON; NaN becomes None."""
        out = asdict(self)
        for value in out.values():
            if isinstance(value, dict):
                value.update({k: None if v != v else v for k, v in value.items()})
        return out


def verdict_table(rows: Sequence[VerdictRow]) -> pl.DataFrame:
    """Verdicts as a table that outcomes can be joined to.

    Returns
    -------
        ``scene_id, im_id, obj_id, est_id, gripper, attempt, probability`` (null where there is no
        forecast); ``est_id`` counts the rows of the same image, object and gripper.
    """
    table = pl.DataFrame(
        [(r.scene_id, r.im_id, r.obj_id, r.gripper, r.verdict.attempt, r.verdict.probability)
         for r in rows],
        schema={
            "scene_id": pl.Int64, "im_id": pl.Int64, "obj_id": pl.Int64, "gripper": pl.String,
            "attempt": pl.Boolean, "probability": pl.Float64,
        },
        orient="row",
    )  # fmt: skip
    same = ("scene_id", "im_id", "obj_id", "gripper")
    return table.with_columns(est_id=pl.int_range(pl.len()).over(same))


def with_outcomes(verdicts: Sequence[VerdictRow], outcomes: pl.DataFrame) -> pl.DataFrame:
    """:func:`verdict_table` of those that have an outcome, with ``success`` (0 or 1) beside."""
    keys = list(_KEYS)
    return verdict_table(verdicts).join(outcomes.select(*keys, "success"), on=keys, how="inner")


def score_verdicts(
    verdicts: Sequence[VerdictRow],
    outcomes: pl.DataFrame,
    *,
    principal: str | None = None,
    dataset: str | None = None,
    draws: int = 2000,
    seed: int = 0,
) -> VerdictScores:
    """Hold verdicts against outcomes.

    Intervals are percentiles under draws of scenes with replacement
    (:mod:`graspcast.evaluation.bootstrap`), since grasps of one scene are not independent.

    Parameters
    ----------
    verdicts
        In the order of :func:`graspcast.forecasting.verdict.verdict_rows`.
    outcomes
        As :func:`graspcast.estimates.outcomes.read_outcomes` gives them.
    principal
        Whose outcomes; may be left out where they are of one estimator.
    dataset
        Which dataset's; may be left out where they are of one.
    draws, seed
        Of the bootstrap.

    Raises
    ------
    UnknownNameError
        For an estimator, dataset or gripper without outcomes.
    InputError
        If outcomes are of several and it is not said which, or none is about a verdict.
    """
    for column, option, name in (
        ("estimator", "--principal", principal),
        ("dataset", "--dataset", dataset),
    ):
        outcomes = _only(outcomes, column, option, name)
    known = outcomes["gripper"].unique().sort().to_list()
    for gripper in sorted({row.gripper for row in verdicts}):
        if gripper not in known:
            raise UnknownNameError("gripper", gripper, known, hint="These have outcomes")
    both = with_outcomes(verdicts, outcomes)
    if not len(both):
        raise InputError("no outcome is about any of the verdicts: are they of the same images?")
    scene, numbers = np.unique(both["scene_id"].to_numpy().astype(str), return_inverse=True)
    attempt = both["attempt"].to_numpy().astype(np.float64)
    success = both["success"].to_numpy().astype(np.float64)
    counts = every_scene_and_draws(scene.tolist(), draws, seed)
    n, tried, held, held_tried = (
        counts @ np.bincount(numbers, weights=weights, minlength=len(scene))
        for weights in (np.ones_like(attempt), attempt, success, attempt * success)
    )
    always, rate = held / n, tried / n
    with np.errstate(invalid="ignore"):
        following = held_tried / tried
    any_tried = tried[0] > 0
    return VerdictScores(
        n=len(both),
        attempts=int(tried[0]),
        scenes=len(scene),
        untried=len(verdicts) - len(both),
        always=Interval.of(always),
        following=Interval.of(following) if any_tried else None,
        attempt_rate=Interval.of(rate),
        gain=Interval.of(following - always) if any_tried else None,
    )


def _only(outcomes: pl.DataFrame, column: str, option: str, name: str | None) -> pl.DataFrame:
    known = outcomes[column].unique().sort().to_list()
    if name is None and len(known) > 1:
        raise InputError(f"the outcomes are of several: {', '.join(known)}; say which, by {option}")
    if name is not None and name not in known:
        raise UnknownNameError(column, name, known, hint="These have outcomes")
    return outcomes if name is None else outcomes.filter(pl.col(column) == name)
