"""Verdicts against outcomes: success rates when always attempting and when following verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import polars as pl

from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.instances import Instances, unit_names
from graspcast.estimates.outcomes import TRIAL_COLUMNS, checked_outcomes, join_outcomes
from graspcast.evaluation.bootstrap import Interval, original_and_draws
from graspcast.evaluation.success_intervals import difference_of, drawn_interval
from graspcast.forecasting.verdict import VerdictRow
from graspcast.io.arguments import a, checked, sequence

__all__ = [
    "VerdictScores",
    "attempt_scores",
    "score_verdicts",
    "verdict_table",
    "with_outcomes",
]


@dataclass(frozen=True)
class VerdictScores:
    """Outcomes of the grasps that verdicts are about.

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
        ``following`` minus ``always``, under the same draws of scenes; None as above.
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
        """Return plain numbers, for JSON; NaN becomes None."""
        out = asdict(self)
        for value in out.values():
            if isinstance(value, dict):
                value.update({k: None if v != v else v for k, v in value.items()})
        return out


def verdict_table(rows: Sequence[VerdictRow]) -> pl.DataFrame:
    """Return verdicts as a table, in their order.

    Returns
    -------
        The key of each trial (:data:`~graspcast.estimates.outcomes.TRIAL_COLUMNS`; ``estimator`` is
        the principal), ``attempt``, and ``probability`` (null where there is no forecast).
    """
    keys = Instances.of([row.key for row in rows]).frame()
    return keys.with_columns(
        estimator=pl.Series([row.principal for row in rows], dtype=pl.String),
        gripper=pl.Series([row.gripper for row in rows], dtype=pl.String),
        grasp=pl.Series([row.grasp for row in rows], dtype=pl.String),
        attempt=pl.Series([row.verdict.attempt for row in rows], dtype=pl.Boolean),
        probability=pl.Series([row.verdict.probability for row in rows], dtype=pl.Float64),
    ).select(*TRIAL_COLUMNS, "attempt", "probability")


def with_outcomes(verdicts: Sequence[VerdictRow], outcomes: pl.DataFrame) -> pl.DataFrame:
    """Return :func:`verdict_table` of the verdicts with an outcome, and ``success`` (0 or 1).

    Raises
    ------
    MismatchError
        If it is not clear which of several instances an outcome is of.
    """
    return join_outcomes(verdict_table(verdicts), outcomes).drop_nulls("success")


@checked(outcomes=a(pl.DataFrame), verdicts=sequence(a(VerdictRow)))
def score_verdicts(
    verdicts: Sequence[VerdictRow], outcomes: pl.DataFrame, *, draws: int = 2000, seed: int = 0
) -> VerdictScores:
    """Score verdicts by the outcomes of the grasps they are about.

    Verdicts and outcomes are joined by the whole key of a trial, so the order of rows does not
    matter. Intervals are by a bootstrap over scenes (:mod:`graspcast.evaluation.bootstrap`), since
    grasps of one scene are not independent. That of a success rate of 0 or 1, at which all draws
    are alike, is exact (:mod:`graspcast.evaluation.success_intervals`).

    Parameters
    ----------
    verdicts
        Of any principals, datasets and grippers.
    outcomes
        As :func:`graspcast.estimates.outcomes.read_outcomes` returns them; outcomes of other grasps
        are left out.
    draws, seed
        Of the bootstrap.

    Raises
    ------
    UnknownNameError
        For a principal, dataset or gripper without outcomes.
    MismatchError
        If no outcome is about any of the verdicts, or an outcome could be of several instances.
    """
    table = verdict_table(verdicts)
    if not len(table):
        raise InputError("there are no verdicts to score", parameters=("verdicts",))
    if table.select(TRIAL_COLUMNS).is_duplicated().any():
        raise InputError("two verdicts are on the same grasp", parameters=("verdicts",))
    outcomes = checked_outcomes(outcomes)
    if not len(outcomes):
        raise InputError("there are no outcomes to score by", parameters=("outcomes",))
    for column in ("estimator", "dataset", "gripper", "grasp"):
        known = outcomes[column].unique().sort().to_list()
        asked = table if column != "grasp" else table.drop_nulls("probability")
        for name in asked[column].unique().sort():
            if name not in known:
                of = f"{(asked[column] == name).sum():,} of {len(table):,} verdicts are of {name!r}"
                hint = f"These have outcomes. {of}: try or simulate these too, or leave them out"
                raise UnknownNameError(column, name, known, hint=hint)
    both = with_outcomes(verdicts, outcomes)
    if not len(both):
        raise MismatchError("no outcome is about any of the verdicts: are they of the same images?")
    return attempt_scores(both, untried=len(verdicts) - len(both), draws=draws, seed=seed)


def attempt_scores(
    both: pl.DataFrame, *, untried: int = 0, draws: int = 2000, seed: int = 0
) -> VerdictScores:
    """Score attempts with known outcomes.

    Parameters
    ----------
    both
        At least one row, with the key of its instance, ``attempt`` and ``success``, as
        :func:`with_outcomes` returns them.
    untried
        As the scores state it.
    draws, seed
        Of the bootstrap over scenes.
    """
    scenes = unit_names(Instances.from_frame(both), "scene")
    scene, numbers = np.unique(scenes, return_inverse=True)
    attempt = both["attempt"].to_numpy().astype(np.float64)
    success = both["success"].to_numpy().astype(np.float64)
    counts = original_and_draws(scene.tolist(), draws, seed)
    n, tried, held, held_tried = (
        counts @ np.bincount(numbers, weights=weights, minlength=len(scene))
        for weights in (np.ones_like(attempt), attempt, success, attempt * success)
    )
    always, rate = held / n, tried / n
    with np.errstate(invalid="ignore"):
        following = held_tried / tried
        gain = following - always
    everything = np.ones(len(both), dtype=np.bool_)
    whole = drawn_interval(everything, success, numbers, counts)
    part = drawn_interval(attempt > 0, success, numbers, counts)
    assert whole is not None
    better = None if part is None else Interval.of(gain[0], gain[1:])
    if part is not None and part.value in (0.0, 1.0) and tried[0] < n[0]:
        better = difference_of(part, whole)
    return VerdictScores(
        n=len(both),
        attempts=int(tried[0]),
        scenes=len(scene),
        untried=untried,
        always=whole,
        following=part,
        attempt_rate=Interval.of(rate[0], rate[1:], (0.0, 1.0)),
        gain=better,
    )
