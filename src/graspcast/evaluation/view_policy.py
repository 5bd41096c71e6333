"""The look-again policy on recorded views: attempts, successes and looks, beside always looking."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.evaluation.bootstrap import Bootstrap, Interval, draw_scenes
from graspcast.evaluation.scores import calibration_error
from graspcast.evaluation.view_table import ONE_VIEW
from graspcast.forecasting.look_again import MIN_GAIN
from graspcast.forecasting.looking import ended_stages
from graspcast.forecasting.view_verdicts import FUSED

__all__ = ["THRESHOLD", "expectation", "policies", "score_policies"]

THRESHOLD = 0.8
"""Probability from which attempts are made."""
_MOST = 3
Taken = dict[str, tuple[Bool[ndarray, " n"], Int[ndarray, " n"], Bool[ndarray, " n"]]]
"""Policy's name to who is attempted, after how many looks, and with which outcome, each (n,)."""


def policies(
    probability: Float[ndarray, "v n"],
    success: Bool[ndarray, "v n"],
    expected: Float[ndarray, "w n"],
    *,
    threshold: float = THRESHOLD,
    min_gain: float = MIN_GAIN,
) -> Taken:
    """Return what each policy does with n instances of which v looks are recorded.

    Parameters
    ----------
    probability
        The forecast after each look; NaN where there is no such look.
    success
        The outcome of the grasp that would be tried after each look.
    expected
        The expected forecast after a further look, for all but the last; NaN where not known.
    threshold
        Attempt at this probability or above it.
    min_gain
        A further look pays if the expected forecast is higher by this much.
    """
    v, n = probability.shape
    every = np.arange(n)
    last = (~np.isnan(probability)).sum(axis=0) - 1
    above = probability >= threshold  # False where there is no such look

    def ended(stage: Int[ndarray, " n"], attempts: Bool[ndarray, " n"] | None = None) -> Any:
        attempts = above[stage, every] if attempts is None else attempts
        return attempts, stage + 1, success[stage, every]

    def stages(most: int, pays: Bool[ndarray, "w n"]) -> Int[ndarray, " n"]:
        further = last > np.arange(most - 1)[:, None]
        return ended_stages(~above[: most - 1] & further & pays[: most - 1])

    always = np.ones((v, n), dtype=bool)
    gain = np.isnan(expected) | (expected >= probability[:-1] + min_gain)
    out = {"always attempt, one look": ended(np.zeros(n, np.int64), np.ones(n, bool))}
    out["one look"] = ended(np.zeros(n, np.int64))
    for most in range(2, v + 1):
        out[f"look again, up to {most}"] = ended(stages(most, always))
        out[f"look again where it pays, up to {most}"] = ended(stages(most, gain))
    for most in range(2, v + 1):
        out[f"always {most} looks"] = ended(np.minimum(last, most - 1))
    out[f"always attempt, {v} looks"] = ended(last, np.ones(n, bool))
    return out


def score_policies(
    found: pl.DataFrame,
    simulated: pl.DataFrame | None = None,
    *,
    threshold: float = THRESHOLD,
    bootstrap: Bootstrap | None = None,
) -> dict[str, Any]:
    """Score the policies for every gripper, guided by single views and by the fused pose.

    Parameters
    ----------
    found
        As :func:`graspcast.evaluation.view_table.forecast_with_views` returns it.
    simulated
        Outcomes of one's own trials; those of the estimators ``fused2`` and ``fused3``, guided by
        poses that are fused from two and three views, are what the fused pose is scored with.
    threshold
        Attempt at this probability or above it.
    bootstrap
        Settings of the intervals.

    Returns
    -------
        ``<guide>.<gripper>.<policy>`` with ``attempts``, ``success`` and ``looks``, each with
        ``_interval``, and ``n``. The guide is ``single view`` (means over principals, published
        outcomes), ``PRINCIPAL, own trials`` or ``fused, own trials``.
    """
    bootstrap = bootstrap or Bootstrap()
    out: dict[str, Any] = {}
    names = [p for p in found["principal"].unique(maintain_order=True).to_list() if p != FUSED]
    for gripper in found["gripper"].unique(maintain_order=True).to_list():
        mine = found.filter(pl.col("gripper") == gripper)
        each = {name: _looks(mine, name) for name in names}
        out.setdefault("single view", {})[gripper] = _scores(each, threshold, bootstrap)
        for guide, looks in _own(mine, simulated, gripper, names).items():
            out.setdefault(guide, {})[gripper] = _scores({guide: looks}, threshold, bootstrap)
    return out


def _looks(mine: pl.DataFrame, principal: str) -> pl.DataFrame:
    """Return each instance of a principal with its forecasts after each look, as columns."""
    rows = mine.filter(pl.col("principal") == principal, pl.col("alone") == "")
    table = None
    for most in range(2, _MOST + 1):
        part = rows.filter(pl.col("row") == f"{most} views").select(
            "instance",
            "scene",
            pl.col("one_view").alias("p1"),
            pl.col("success").alias("s1"),
            pl.when(pl.col("views") >= most).then("probability").alias(f"p{most}"),
            pl.col("success").alias(f"s{most}"),
        )
        if table is None:
            table = part
        else:
            table = table.join(part.select("instance", f"p{most}", f"s{most}"), on="instance")
    assert table is not None
    belief = mine.filter(pl.col("principal") == FUSED)
    for looks, row in enumerate((ONE_VIEW.name, "2 views"), 1):
        more = belief.filter(pl.col("row") == row).select(
            "instance", pl.col("expected").alias(f"e{looks}")
        )
        table = table.join(more, on="instance", how="left", maintain_order="left")
    return table


def _own(
    mine: pl.DataFrame, simulated: pl.DataFrame | None, gripper: str, names: Sequence[str]
) -> dict[str, pl.DataFrame]:
    """Return the looks of guides with outcomes of one's own trials on the same instances."""
    needed = [f"{FUSED}{v}" for v in range(2, _MOST + 1)]
    if simulated is None or not set(needed) <= set(simulated["estimator"].unique()):
        return {}
    key = pl.concat_str("dataset", "scene_id", "im_id", separator="/").alias("image")
    name = pl.concat_str("dataset", "obj_id", separator="-").alias("object")
    trials = simulated.filter(pl.col("gripper") == gripper, pl.col("est_id") == 0)
    outcomes = {
        estimator: trials.filter(pl.col("estimator") == estimator).select(
            key, name, pl.col("success").cast(pl.Boolean).alias("own")
        )
        for estimator in (*names, *needed)
    }
    keys = mine.select("instance", "image", "object").unique(maintain_order=True)
    out = {}
    for principal in names:
        if not len(outcomes[principal]):
            continue
        table = _looks(mine, principal).join(keys, on="instance", maintain_order="left")
        for v, estimator in enumerate([principal, *needed], 1):
            of = outcomes[estimator].rename({"own": f"own{v}"})
            table = table.join(of, on=["image", "object"], maintain_order="left")
        table = table.drop_nulls([f"own{v}" for v in range(1, _MOST + 1)])
        if not len(table):
            continue
        single = table.with_columns(pl.col("own1").alias(f"s{v}") for v in range(1, _MOST + 1))
        out[f"{principal}, own trials"] = single
        fused = table.with_columns(pl.col(f"own{v}").alias(f"s{v}") for v in range(1, _MOST + 1))
        for v in range(2, _MOST + 1):
            part = mine.filter(pl.col("principal") == FUSED, pl.col("row") == f"{v} views").select(
                "instance",
                pl.when(pl.col("views") >= v).then("probability").alias("own_p"),
            )
            fused = fused.join(part, on="instance", how="left", maintain_order="left")
            fused = fused.with_columns(pl.col("own_p").alias(f"p{v}")).drop("own_p")
        out[f"{principal}, then fused, own trials"] = fused
    return out


def _scores(
    each: Mapping[str, pl.DataFrame], threshold: float, bootstrap: Bootstrap
) -> dict[str, Any]:
    """Score the policies, averaged over guides."""
    scenes = sorted(set().union(*(t["scene"].to_list() for t in each.values())))
    counts = draw_scenes(scenes, bootstrap.draws, bootstrap.seed)
    counts = np.concatenate([np.ones((1, len(scenes)), dtype=counts.dtype), counts])
    sums: dict[str, list[ndarray]] = {}
    for table in each.values():
        stage = range(1, _MOST + 1)
        taken = policies(
            np.stack([table[f"p{v}"].fill_null(np.nan).to_numpy() for v in stage]),
            np.stack([table[f"s{v}"].to_numpy().astype(bool) for v in stage]),
            np.stack([table[f"e{v}"].fill_null(np.nan).to_numpy() for v in stage if v < _MOST]),
            threshold=threshold,
        )
        place = np.searchsorted(scenes, table["scene"].to_numpy().astype(str))
        for name, (attempts, looks, success) in taken.items():
            values = (np.ones(len(table)), attempts, attempts & success, looks)
            per_scene = [np.bincount(place, v, minlength=len(scenes)) for v in values]
            drawn = np.stack([counts @ one for one in per_scene])
            with np.errstate(invalid="ignore", divide="ignore"):
                rates = np.stack([drawn[1] / drawn[0], drawn[2] / drawn[1], drawn[3] / drawn[0]])
            sums.setdefault(name, []).append(rates)
    out: dict[str, Any] = {"n": float(np.mean([len(t) for t in each.values()]))}
    for name, rates_of_each in sums.items():
        mean = np.mean(rates_of_each, axis=0)
        out[name] = {}
        for what, row in zip(("attempts", "success", "looks"), mean, strict=True):
            limits = (0.0, np.inf if what == "looks" else 1.0)
            found = Interval.of(row[0], row[1:], limits, confidence=bootstrap.confidence)
            value = None if np.isnan(found.value) else found.value
            out[name] |= {what: value, f"{what}_interval": found.ends}
    return out


def expectation(found: pl.DataFrame) -> list[dict[str, Any]]:
    """Compare the expected forecast after a further look with the forecast after it.

    Both are of grasps that the fused pose guides. One entry for each gripper and number of looks:
    ``n``, the mean forecasts ``before``, ``expected`` and ``after`` the look, the mean absolute
    difference of the last two in bins of the expected one (``calibration``), and their correlation.
    """
    out = []
    fused = found.filter(pl.col("principal") == FUSED)
    names = [ONE_VIEW.name, *(f"{v} views" for v in range(2, _MOST + 1))]
    for gripper in found["gripper"].unique(maintain_order=True).to_list():
        for looks in range(1, _MOST):
            now, later = (
                fused.filter(pl.col("gripper") == gripper, pl.col("row") == names[k])
                for k in (looks - 1, looks)
            )
            if not len(now):
                continue
            later = later.filter(pl.col("views") > looks)
            pairs = now.join(later, on="instance", suffix="_after").drop_nulls(
                ["expected", "probability", "probability_after"]
            )
            before, expected, after = (
                pairs[c].to_numpy() for c in ("probability", "expected", "probability_after")
            )
            out.append(
                {
                    "gripper": gripper,
                    "looks": looks,
                    "n": len(pairs),
                    "before": float(before.mean()),
                    "expected": float(expected.mean()),
                    "after": float(after.mean()),
                    "calibration": calibration_error(expected, after),
                    "correlation": _correlation(expected, after),
                }
            )
    return out


def _correlation(x: Float[ndarray, " n"], y: Float[ndarray, " n"]) -> float | None:
    """Return the correlation; None where one of them is constant."""
    if np.ptp(x) < 1e-9 or np.ptp(y) < 1e-9:
        return None
    return float(np.corrcoef(x, y)[0, 1])
