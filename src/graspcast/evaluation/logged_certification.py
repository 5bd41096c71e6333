"""Certification from attempt logs: what was decided by a model, and what came of it.

A log knows outcomes of attempts alone: of what reached the threshold that was used. So no threshold
below it can be certified, and a policy that looks again, whose threshold decides when it stops
looking, can be certified at that threshold alone. Forecasts and outcomes are those of the log;
nothing is forecast again. What was decided by another model says nothing: which grasps *this* model
would attempt was not tried.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import polars as pl

from graspcast.attempt_log.episodes import scene_of
from graspcast.attempt_log.log import AttemptLog
from graspcast.errors import MismatchError
from graspcast.estimates.instances import InstanceKey, Instances, split_object_name
from graspcast.evaluation.certification import (
    CalibrationTrials,
    GuaranteeOptions,
    certify_trials,
    check_scenes,
    learned_sequence,
)
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.recorded_verdicts import ViewSettings, guides_of, policy_of
from graspcast.guarantees.certificate import Certificate
from graspcast.guarantees.threshold_sequence import (
    ThresholdSequence,
    default_sequence,
    from_threshold_on,
)
from graspcast.io.arguments import a, checked, sequence
from graspcast.io.wording import counted

__all__ = ["LoggedCertificate", "certify_log"]


@dataclass(frozen=True)
class LoggedCertificate:
    """A certificate from logs, and what was left out, in words."""

    certificate: Certificate
    notes: tuple[str, ...]


@checked(
    forecaster=a(Forecaster),
    logs=sequence(a(AttemptLog)),
    asked=a(GuaranteeOptions),
    settings=a(ViewSettings),
)
def certify_log(
    forecaster: Forecaster,
    logs: Sequence[AttemptLog],
    asked: GuaranteeOptions | None = None,
    settings: ViewSettings | None = None,
    *,
    views: bool = False,
) -> LoggedCertificate:
    """Find the threshold at which a model's attempts are guaranteed to succeed, from attempt logs.

    Parameters
    ----------
    forecaster
        The model that decided.
    logs
        Attempt logs; episodes are scenes.
    asked
        What is to be guaranteed. ``sequence_share`` should be 0.
    settings
        The policy by which was decided: who guides, and how many looks.
    views
        Whether it used camera poses.

    Raises
    ------
    MismatchError
        If no outcome is of an attempt of this model by this policy, or a policy with several views
        or looks was used with several thresholds, or the model was trained on some of the episodes.
    InputError
        As :func:`graspcast.certify`.
    """
    asked, settings = asked or GuaranteeOptions(), settings or ViewSettings()
    if asked.sequence_share:
        raise MismatchError(
            "from an attempt log, the sequence of thresholds is that of the model's out-of-fold "
            "predictions; leave out the share of units that would teach it",
            parameters=("sequence_share",),
        )
    policy = policy_of(forecaster, settings, views=views)
    guides = guides_of(forecaster, policy)
    left: Counter[str] = Counter()
    rows = _final(_of_model(forecaster, logs, guides, policy is not None, left))
    lowest = _lowest_threshold(rows, policy is not None)
    trials = _trials(rows, lowest, left)
    seen = check_scenes(forecaster.card, trials.instances, asked.allow_training_scenes)
    more = {"from_log": True} | ({} if policy is None else {"guides": guides})
    order = _sequence(forecaster, trials.instances, asked, lowest, policy is not None)
    certificate = certify_trials(
        forecaster.card, trials, asked, seen, sequence=order, provenance=more
    )
    notes = [f"left out {counted(n, 'decision')}: {why}" for why, n in sorted(left.items())]
    if policy is not None:
        notes.append(f"the policy was run with the threshold {lowest:g}; no other is certified")
    elif lowest > 0.0:
        notes.append(
            f"nothing below the threshold {lowest:g} was attempted, so none below it is certified"
        )
    return LoggedCertificate(replace(certificate, policy=policy), tuple(notes))


def _of_model(
    forecaster: Forecaster,
    logs: Sequence[AttemptLog],
    guides: Sequence[str],
    several: bool,
    left: Counter[str],
) -> pl.DataFrame:
    """Return the decisions that the model made by the policy; counts the others."""
    table = pl.concat([log.table() for log in logs]).unique("id", maintain_order=True)
    card = forecaster.card
    digests = sorted({digest or "unknown" for digest in table["model"]})
    conditions = {
        "another model's": pl.col("model") == card.digest,
        f"with another gripper than {card.gripper}": pl.col("gripper") == card.gripper,
        f"guided by others than {', '.join(guides)}": pl.col("guide").is_in(guides)
        | pl.col("guide").is_null(),
    }
    if not several:
        first = (pl.col("look") == 1) & (pl.col("views") <= 1)
        conditions["after a further look, while one view is to be certified"] = first
    for why, condition in conditions.items():
        kept = table.filter(condition.fill_null(False))
        left[why] += len(table) - len(kept)
        table = kept
    left += Counter()  # drops zeros
    if not table["success"].count():
        known = ", ".join(digest[:12] for digest in digests[:5])
        told = "; ".join(f"{n} {why}" for why, n in left.items())
        raise MismatchError(
            f"{', '.join(str(log.path) for log in logs)}: no outcome of an attempt of this model "
            f"({card.digest[:12]}) by this policy"
            + (f"; the decisions are {told}" if told else "")
            + (f"; models there: {known}" if known else ""),
            parameters=("from_log", "model", "guide"),
        )
    return table


def _final(table: pl.DataFrame) -> pl.DataFrame:
    """Return one decision for each instance of an episode: its first attempt, or the last one."""
    attempt = (pl.col("action") == "attempt").alias("attempted")
    rank = pl.when(attempt).then(pl.col("look")).otherwise(10**9 - pl.col("look"))
    keys = ["episode", "instance", "object_name"]
    return (
        table.with_columns(attempt)
        .sort(rank, maintain_order=True)
        .unique(keys, keep="first", maintain_order=True)
    )


def _lowest_threshold(rows: pl.DataFrame, several: bool) -> float:
    """Return the largest threshold that was used: nothing below it was attempted throughout."""
    used = sorted(set(rows["threshold"].drop_nulls().to_list())) or [0.0]
    if several and len(used) > 1:
        raise MismatchError(
            f"the policy was run with the thresholds {', '.join(f'{t:g}' for t in used)}, and one "
            "that looks again attempts something else at each; give a log with one",
            parameters=("from_log",),
        )
    return float(used[-1])


def _trials(rows: pl.DataFrame, lowest: float, left: Counter[str]) -> CalibrationTrials:
    """Return forecasts and outcomes; what is never attempted from the threshold on has none."""
    tried = (
        pl.col("attempted")
        & pl.col("probability").is_not_null()
        & (pl.col("probability") >= lowest)
    ).fill_null(False)
    unknown = tried & pl.col("success").is_null()
    without = rows.filter(unknown)
    if len(without):
        left["attempts without an outcome"] += len(without)
    rows = rows.filter(~unknown)
    keys = []
    for row in rows.select("episode", "look", "object_name", "instance").iter_rows():
        dataset, number = split_object_name(row[2])
        keys.append(InstanceKey(dataset, scene_of(row[0]), row[1], number, max(row[3], 0)))
    several = rows.group_by("episode").agg(
        pl.col("object_name").str.replace(r"-\d+$", "").n_unique().alias("n")
    )
    if (several["n"] > 1).any():
        raise MismatchError(
            "some episodes have objects of several datasets, whose trials would not be independent "
            "units; log them under one dataset's name",
            parameters=("from_log",),
        )
    kept = rows.with_columns(p=pl.when(tried).then(pl.col("probability")))
    p = kept["p"].fill_null(float("nan")).to_numpy()
    success = kept["success"].fill_null(False).to_numpy().astype(bool)
    return CalibrationTrials(Instances.of(keys), p[:, None].astype(float), success[:, None])


def _sequence(
    forecaster: Forecaster,
    instances: Instances,
    asked: GuaranteeOptions,
    lowest: float,
    several: bool,
) -> ThresholdSequence:
    if several:
        return ThresholdSequence((lowest,), (1.0,), "the threshold of the log")
    learned = learned_sequence(forecaster, instances, asked)
    return from_threshold_on(learned or default_sequence(asked.rate), lowest)
