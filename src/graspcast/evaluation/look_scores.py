"""Verdicts after each look against outcomes: what looking again is worth, and its cost in looks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.errors import InputError, MismatchError
from graspcast.estimates.instances import Instances, unit_names
from graspcast.estimates.outcomes import checked_outcomes, join_outcomes
from graspcast.evaluation.bootstrap import Interval, original_and_draws
from graspcast.evaluation.success_intervals import drawn_interval
from graspcast.evaluation.verdict_scores import verdict_table
from graspcast.forecasting.looking import ended_stages
from graspcast.forecasting.verdict import InstanceLooks, VerdictRow
from graspcast.forecasting.view_verdicts import FUSED

__all__ = ["LookScores", "PolicyScore", "Stage", "check_covered", "score_looks", "stages_of"]


@dataclass(frozen=True, eq=False)
class Stage:
    """Verdicts with so many views at most, and the outcomes of the grasps they are about.

    Attributes
    ----------
    verdicts
        One for each instance, in the same order at every stage.
    outcomes
        As :func:`graspcast.estimates.outcomes.read_outcomes` returns them, of all guides.
    looks
        How many looks were taken of each instance; None: as many as the verdict rests on.
    """

    verdicts: Sequence[VerdictRow]
    outcomes: pl.DataFrame
    looks: Int[ndarray, " n"] | None = None


@dataclass(frozen=True)
class PolicyScore:
    """How often the attempts of a policy succeed, and what it costs.

    Attributes
    ----------
    name
        The policy, in words.
    success
        Success rate of its attempts; None if there are none.
    attempt_rate
        Share of the instances that is attempted.
    attempts
        How many that is.
    looks
        Mean number of looks that were taken.
    """

    name: str
    success: Interval | None
    attempt_rate: Interval
    attempts: int
    looks: float


@dataclass(frozen=True)
class LookScores:
    """Policies on the same instances.

    Attributes
    ----------
    n, scenes
        Instances with an outcome at every stage, and their scenes.
    policies
        One look and all looks, each with all attempted and by verdicts, and look again.
    untried
        Instances that lack an outcome at some stage, and do not count.
    """

    n: int
    scenes: int
    policies: tuple[PolicyScore, ...]
    untried: int = 0

    def as_dict(self) -> dict[str, Any]:
        """Return plain numbers, for JSON; NaN becomes None."""
        out = asdict(self)
        for policy in out["policies"]:
            for name in ("success", "attempt_rate"):
                if policy[name] is not None:
                    policy[name] = {k: None if v != v else v for k, v in policy[name].items()}
        return out


def stages_of(looks: Sequence[InstanceLooks], outcomes: pl.DataFrame) -> list[Stage]:
    """Return the stages of the verdicts after each look, where always so many looks are allowed.

    An instance of which there are fewer images keeps the verdict after the last of them.

    Parameters
    ----------
    looks
        Of all instances.
    outcomes
        Of the grasps that each guide would try after each look.

    Raises
    ------
    InputError
        If there are no verdicts.
    MismatchError
        If the outcomes have none of a guide.
    """
    if not looks:
        raise InputError("there are no verdicts to score", parameters=("stages",))
    check_covered([row for each in looks for row in each.rows], outcomes)
    taken = np.array([len(each.rows) for each in looks])
    out = []
    for most in range(1, int(taken.max()) + 1):
        mine = np.minimum(taken, most)
        rows = [each.rows[k - 1] for each, k in zip(looks, mine.tolist(), strict=True)]
        out.append(Stage(rows, outcomes, mine))
    return out


def check_covered(rows: Sequence[VerdictRow], outcomes: pl.DataFrame) -> None:
    """Check that there are outcomes of every guide, by dataset, gripper and grasp.

    Raises
    ------
    MismatchError
        Naming those that have none, and how to make them.
    """
    by = ["estimator", "dataset", "gripper", "grasp"]
    # What has no forecast is never attempted, and may be a guide's that lacks the instance.
    forecast = [row for row in rows if row.verdict.probability is not None]
    needed = verdict_table(forecast or rows).select(by).unique().sort(by)
    missing = needed.join(checked_outcomes(outcomes), on=by, how="anti").sort(by)
    if not len(missing):
        return
    what = "; ".join(
        f"{guide} on {dataset} ({gripper} gripper, {grasp} grasp)"
        for guide, dataset, gripper, grasp in missing.rows()
    )
    hint = ""
    for name in missing["estimator"].unique().sort().to_list():
        if name.startswith(FUSED):
            views = name.removeprefix(FUSED)
            most = f"up to {views} views" if views else "several views"
            hint += f"; those of {name} are trials guided by the poses fused from {most}"
    raise MismatchError(f"there are no outcomes of {what}{hint}", parameters=("outcomes",))


def score_looks(stages: Sequence[Stage], *, draws: int = 2000, seed: int = 0) -> LookScores:
    """Score one look, looking again while the verdicts say so, and always all looks.

    Looking again goes on until a verdict attempts or abstains; where the recorded views end, the
    last verdict counts, and "look again" is no attempt. Intervals are by drawing scenes; that of a
    success rate of 0 or 1 is exact (:mod:`graspcast.evaluation.success_intervals`).

    Parameters
    ----------
    stages
        Verdicts with one view, with up to two views, and so on.
    draws, seed
        Of the bootstrap.

    Raises
    ------
    MismatchError
        If the stages are of different instances, or none has an outcome at every stage.
    """
    first = [_place(row) for row in stages[0].verdicts]
    if any([_place(row) for row in stage.verdicts] != first for stage in stages):
        raise MismatchError("the verdicts after each look are on different instances")
    attempt, success, views, again = (np.stack(x) for x in zip(*map(_columns, stages), strict=True))
    known = ~np.isnan(success).any(axis=0)
    if not known.any():
        counts_of = ", ".join(str(int(n)) for n in (~np.isnan(success)).sum(axis=1))
        raise MismatchError(
            f"no instance has an outcome after each look; by looks there are {counts_of}, of "
            f"{len(first)} instances",
            parameters=("outcomes",),
        )
    keys = Instances.of([row.key for row in stages[0].verdicts])
    names = np.array(unit_names(keys, "scene"))[known]
    attempt, success, views, again = (x[:, known] for x in (attempt, success, views, again))
    scene, numbers = np.unique(names, return_inverse=True)
    counts = original_and_draws(scene.tolist(), draws, seed)
    end, every = ended_stages(again[:-1]), np.arange(attempt.shape[1])
    last = len(stages) - 1
    looks = {0: "one look", 1: "two looks", 2: "three looks"}.get(last, f"{last + 1} looks")
    ends: dict[str, tuple[ndarray, bool]] = {
        "one look, always attempting": (np.zeros_like(end), True),
        "one look, verdicts": (np.zeros_like(end), False),
        "look again when in doubt, verdicts": (end, False),
        f"always {looks}, verdicts": (np.full_like(end, last), False),
        f"always {looks}, always attempting": (np.full_like(end, last), True),
    }
    scored = tuple(
        _scored(
            name,
            attempt[stage, every] | always,
            success[stage, every],
            views[stage, every],
            counts,
            numbers,
        )
        for name, (stage, always) in ends.items()
    )
    return LookScores(int(known.sum()), len(scene), scored, int((~known).sum()))


def _columns(stage: Stage) -> tuple[ndarray, ndarray, ndarray, ndarray]:
    """Return who is attempted, whether it succeeds (NaN if unknown), views, and who looks again."""
    table = join_outcomes(verdict_table(stage.verdicts), stage.outcomes)
    return (
        table["attempt"].to_numpy(),
        table["success"].cast(pl.Float64).fill_null(float("nan")).to_numpy(),
        np.array([row.views for row in stage.verdicts]) if stage.looks is None else stage.looks,
        np.array([row.verdict.look is not None for row in stage.verdicts]),
    )


def _place(row: VerdictRow) -> tuple[str, int, int, int]:
    """Return whose instance it is, but for ``est_id``, which is each guide's own."""
    return row.key.dataset, row.key.scene_id, row.key.im_id, row.key.obj_id


def _scored(
    name: str,
    attempt: Bool[ndarray, " n"],
    success: Float[ndarray, " n"],
    views: Int[ndarray, " n"],
    counts: Int[ndarray, "draws1 scenes"],
    numbers: Int[ndarray, " n"],
) -> PolicyScore:
    n, tried = (
        counts @ np.bincount(numbers, weights=weights, minlength=counts.shape[1])
        for weights in (np.ones_like(success), attempt.astype(float))
    )
    share, limits = tried / n, (0.0, 1.0)
    return PolicyScore(
        name=name,
        success=drawn_interval(attempt, success, numbers, counts),
        attempt_rate=Interval.of(share[0], share[1:], limits),
        attempts=int(tried[0]),
        looks=float(views.mean()),
    )
