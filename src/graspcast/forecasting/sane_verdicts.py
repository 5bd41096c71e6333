"""Verdicts on instances whose poses are all sane."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import repeat
from typing import TYPE_CHECKING

import numpy as np

from graspcast.bop.models import Models
from graspcast.estimates.alignment import Estimates
from graspcast.forecasting.attribution import attributions
from graspcast.forecasting.novelty import Disagreement
from graspcast.forecasting.verdict import Verdict, decide

if TYPE_CHECKING:
    from graspcast.forecasting.forecaster import Forecaster

__all__ = ["decide_sane"]


def decide_sane(
    forecaster: Forecaster,
    estimates: Estimates,
    models: Mapping[str, Models] | None,
    *,
    threshold: float | None,
    guarantee: str | None,
    ood_alpha: float,
    explain: bool,
) -> list[Verdict]:
    """Decide on instances without a problem; the parameters are those of ``verdicts``.

    Of one estimator's single view the reason says on how little the forecast rests, and whether it
    is out of distribution is told only where the pose is elsewhere than in training.
    """
    found, numbers = forecaster._inputs(estimates, models)
    attribution: Iterable[tuple[tuple[str, float], ...]] = repeat((), len(estimates))
    if explain:
        attribution = attributions(forecaster.predictor, found, numbers, forecaster.typical)
    given: list[Disagreement | None] = list(forecaster._disagreements(estimates))
    alone = forecaster.visibility
    if alone is not None:  # without a supporter there is no p-value
        given = [each if each is not None and each.excess else None for each in given]
    out = [
        decide(
            p,
            threshold,
            guarantee=guarantee,
            disagreement=each,
            ood_alpha=ood_alpha,
            attribution=why,
        )
        for p, each, why in zip(
            forecaster.predictor.probability(found.values, numbers).tolist(),
            given,
            attribution,
            strict=True,
        )
    ]
    if alone is None:
        return out
    rests = alone.rests_on(found.values, numbers)
    return [_said(verdict, what) for verdict, what in zip(out, rests, strict=True)]


def _said(verdict: Verdict, what: str) -> Verdict:
    """Say on what a verdict from one view of one estimator rests."""
    reason = f"{verdict.reason}; one view of one estimator: rests on {what}, mostly visibility"
    unusual = True if verdict.out_of_distribution else None
    p_value = None if verdict.p_value is None or np.isnan(verdict.p_value) else verdict.p_value
    return replace(verdict, reason=reason, out_of_distribution=unusual, p_value=p_value)
