"""Verdicts on instances whose poses are all sane."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import repeat
from typing import TYPE_CHECKING, Any

import numpy as np

from graspcast.bop.models import Models
from graspcast.estimates.alignment import Estimates
from graspcast.forecasting.attribution import attributions
from graspcast.forecasting.grasp_ranking import Reachable, nothing_reachable
from graspcast.forecasting.grasps_of_instances import ranking_of
from graspcast.forecasting.novelty import Disagreement
from graspcast.forecasting.verdict import Verdict, chosen, decide

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
    reachable: Reachable | None = None,
) -> list[Verdict]:
    """Decide on instances without a problem; the parameters are those of ``verdicts``.

    Of one estimator's single view the reason says on how little the forecast rests, and whether it
    is out of distribution is told only where the pose is elsewhere than in training.
    """
    found, numbers = forecaster._inputs(estimates, models)
    ranking = None
    if forecaster.card.grasps or reachable is not None:
        ranking = ranking_of(forecaster, found, estimates, numbers, reachable)
        numbers = ranking.targets
        if not (able := numbers >= 0).all():
            options: dict[str, Any] = {"threshold": threshold, "guarantee": guarantee}
            options |= {"ood_alpha": ood_alpha, "explain": explain, "reachable": reachable}
            some = estimates.select(able)
            given_some = decide_sane(forecaster, some, models, **options) if able.any() else []
            rest = iter(given_some)
            names = estimates.objects.tolist()
            return [
                next(rest) if yes else _unreachable(forecaster, name)
                for yes, name in zip(able.tolist(), names, strict=True)
            ]
    attribution: Iterable[tuple[tuple[str, float], ...]] = repeat((), len(estimates))
    if explain:
        attribution = attributions(forecaster.predictor, found, numbers, forecaster.typical)
    given: list[Disagreement | None] = list(forecaster._disagreements(estimates))
    alone = forecaster.visibility
    if alone is not None:  # without a supporter there is no p-value
        given = [each if each is not None and each.excess else None for each in given]
    if ranking is None:
        probability = forecaster.predictor.probability(found.values, numbers)
    else:
        probability = ranking.probability
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
            probability.tolist(),
            given,
            attribution,
            strict=True,
        )
    ]
    if ranking is not None and forecaster.card.grasps:
        out = [chosen(each, some) for each, some in zip(out, ranking.grasps, strict=True)]
    if alone is None:
        return out
    rests = alone.rests_on(found.values, numbers)
    return [_said(verdict, what) for verdict, what in zip(out, rests, strict=True)]


def _unreachable(forecaster: Forecaster, name: str) -> Verdict:
    """Return the verdict where the robot reaches no grasp."""
    return Verdict(False, None, nothing_reachable(forecaster.card, name))


def _said(verdict: Verdict, what: str) -> Verdict:
    """Say on what a verdict from one view of one estimator rests."""
    reason = f"{verdict.reason}; one view of one estimator: rests on {what}, mostly visibility"
    unusual = True if verdict.out_of_distribution else None
    p_value = None if verdict.p_value is None or np.isnan(verdict.p_value) else verdict.p_value
    return replace(verdict, reason=reason, out_of_distribution=unusual, p_value=p_value)
