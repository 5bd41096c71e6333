"""Certification of verdicts with several views, and of looking again, as one policy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import polars as pl
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.errors import MismatchError
from graspcast.estimates.instances import Instances
from graspcast.estimates.loading import Inputs
from graspcast.estimates.outcomes import join_outcomes
from graspcast.evaluation.certification import (
    CalibrationTrials,
    GuaranteeOptions,
    certify_trials,
    check_scenes,
)
from graspcast.evaluation.look_scores import check_covered
from graspcast.evaluation.verdict_scores import verdict_table
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.looking import PolicyRun, run_at_once, run_policy
from graspcast.forecasting.recorded_looks import check_motions
from graspcast.forecasting.recorded_verdicts import (
    ViewSettings,
    check_views,
    guides_of,
    policy_of,
)
from graspcast.forecasting.verdict import VerdictRow
from graspcast.guarantees.attempts import first_to_reach
from graspcast.guarantees.certificate import Certificate
from graspcast.io.arguments import a, checked, mapping
from graspcast.io.wording import counted
from graspcast.views.camera_motion import CameraMotion

__all__ = ["PolicyTrials", "certify_policy", "policy_trials"]


class PolicyTrials(NamedTuple):
    """Calibration trials of a policy, and how many instances lack an outcome."""

    trials: CalibrationTrials
    untried: int


@checked(
    forecaster=a(Forecaster),
    inputs=a(Inputs),
    motions=mapping(a(CameraMotion), "dataset"),
    settings=a(ViewSettings),
    outcomes=a(pl.DataFrame),
)
def certify_policy(
    forecaster: Forecaster,
    inputs: Inputs,
    motions: Mapping[str, CameraMotion],
    settings: ViewSettings,
    outcomes: pl.DataFrame,
    asked: GuaranteeOptions | None = None,
) -> Certificate:
    """Find the threshold at which attempts by a policy are guaranteed to succeed at a rate.

    The policy looks until the probability reaches the threshold, or a further look does not pay, or
    ``settings.max_looks`` looks were taken. With one look allowed, it decides by one verdict with
    the views that there are. The order of thresholds is learned from ``asked.sequence_share`` of
    the units, or depends on no data: the model's out-of-fold predictions are of single views.

    Parameters
    ----------
    forecaster
        Whose forecasts are certified.
    inputs
        Estimates of scenes that were not used in training; its notes get what is left out.
    motions
        Dataset's name to its camera motion; none if each image is judged alone.
    settings
        Which views serve, who guides, and how many looks.
    outcomes
        Of the grasps that each guide would try after each look.
    asked
        What is to be guaranteed.

    Returns
    -------
        Its :attr:`~graspcast.guarantees.certificate.Certificate.policy` is stated where it is more
        than the principal's one view.

    Raises
    ------
    MismatchError
        If the forecaster was trained on some of the scenes, or without views, or outcomes of a
        guide are missing.
    InputError, UnknownNameError
        As :func:`graspcast.certify`, and for an unknown guide.
    """
    asked = asked or GuaranteeOptions()
    check_views([forecaster], settings, motions)
    check_motions(inputs, motions)
    found = [
        policy_trials(forecaster, inputs, dataset, motions.get(dataset), settings, outcomes, asked)
        for dataset in inputs.results
    ]
    trials = CalibrationTrials(
        Instances.concatenate([part.trials.instances for part in found]),
        np.concatenate([part.trials.probability for part in found]),
        np.concatenate([part.trials.success for part in found]),
    )
    if untried := sum(part.untried for part in found):
        inputs.notes.append(
            f"left out {counted(untried, 'instance', 'that lacks', 'that lack')} an outcome of a "
            "grasp that might be tried"
        )
    if not len(trials.instances):
        raise MismatchError(
            "no instance has an outcome of every grasp that might be tried: are the outcomes of "
            "these images?",
            parameters=("outcomes",),
        )
    seen = check_scenes(forecaster.card, trials.instances, asked.allow_training_scenes)
    policy = policy_of(forecaster, settings, views=bool(motions))
    more = {} if policy is None else {"guides": guides_of(forecaster, policy)}
    certificate = certify_trials(forecaster.card, trials, asked, seen, provenance=more)
    return replace(certificate, policy=policy)


def policy_trials(
    forecaster: Forecaster,
    inputs: Inputs,
    dataset: str,
    motion: CameraMotion | None,
    settings: ViewSettings,
    outcomes: pl.DataFrame,
    asked: GuaranteeOptions,
) -> PolicyTrials:
    """Run a policy over recorded images of one dataset, and join it with outcomes.

    An instance counts if there is an outcome of the grasp after its first look, and after each
    further one whose forecast is larger than those before: no other is ever attempted.

    Parameters
    ----------
    forecaster, inputs, settings, outcomes, asked
        As for :func:`certify_policy`.
    dataset, motion
        Which of the datasets, and its camera motion.
    """
    run: PolicyRun = (run_policy if settings.max_looks > 1 else run_at_once)(
        forecaster, inputs, dataset, motion, settings, threshold=1.0, ood_alpha=asked.ood_alpha
    )
    probability = run.probability
    tried = first_to_reach(probability)
    probability = np.where(tried, probability, np.nan)
    needed = tried.copy()
    needed[:, 0] = True
    rows = [
        row
        for stage, mine in zip(run.stages, needed.T, strict=True)
        for row, wanted in zip(stage, mine.tolist(), strict=True)
        if wanted
    ]
    check_covered(rows, outcomes)
    held = np.stack([_success(stage, outcomes) for stage in run.stages], axis=1)
    known = ~(needed & np.isnan(held)).any(axis=1)
    trials = CalibrationTrials(
        run.instances.select(known), probability[known], _is_one(held[known])
    )
    return PolicyTrials(trials, int((~known).sum()))


def _success(rows: list[VerdictRow], outcomes: pl.DataFrame) -> Float[ndarray, " n"]:
    """Return the outcomes of the grasps that verdicts are about; NaN where there is none."""
    found = join_outcomes(verdict_table(rows), outcomes)["success"]
    return found.cast(pl.Float64).fill_null(float("nan")).to_numpy()


def _is_one(values: Float[ndarray, "n s"]) -> Bool[ndarray, "n s"]:
    return np.asarray(values == 1.0)
