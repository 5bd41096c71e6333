"""Comparison of pose estimators as principal, and of the supporters of each, by cross-validation.

All forecasts are for scenes that the forecaster was not trained on. The criterion is the area under
the risk-coverage curve (AURC): the failure rate of attempts, averaged over all attempt rates. It
was chosen before the data were seen; the other measures are given beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from graspcast.bop.models import Models
from graspcast.errors import InputError, MismatchError
from graspcast.evaluation.bootstrap import Interval
from graspcast.evaluation.paired_differences import (
    CRITERION,
    FORECAST_MEASURES,
    PRINCIPAL_MEASURES,
    PairedDifference,
    ScoreDraws,
    bootstrap_scores,
    improvements,
    original_scores,
)
from graspcast.evaluation.principal_forecasts import (
    PrincipalForecasts,
    common_rows,
    forecast_principals,
)
from graspcast.evaluation.principal_views import PrincipalViews, view_forecasts
from graspcast.evaluation.view_worth import ViewWorth, worth_of_views
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.training_data import TrainingData
from graspcast.io.arguments import a, checked, mapping, sequence
from graspcast.io.progress import Progress, step_of

__all__ = ["Comparison", "SupporterComparison", "compare"]


@dataclass(frozen=True)
class SupporterComparison:
    """Scores of forecasts for one principal: with all supporters, without each, with each alone.

    Attributes
    ----------
    principal
        Its name.
    n
        Number of instances with an outcome and forecasts.
    without_forecast
        Number of instances whose object is in no other scene, so that there is no forecast.
    scenes
        Number of scenes (or blocks of frames).
    success_rate
        When every estimate is attempted.
    scores
        Each of :data:`FORECAST_MEASURES`, with all supporters.
    without
        By supporter, forecasts by all others; empty if there is only one supporter.
    alone
        By supporter, forecasts by it alone; empty if there is only one supporter.
    """

    principal: str
    n: int
    without_forecast: int
    scenes: int
    success_rate: float
    scores: Mapping[str, float]
    without: Mapping[str, PairedDifference]
    alone: Mapping[str, PairedDifference]


@dataclass(frozen=True)
class Comparison:
    """The result of :func:`compare`.

    Attributes
    ----------
    gripper
        With which the grasps were tried.
    estimators
        All estimators.
    principals
        By name, those that have outcomes.
    common, scenes
        Number of instances that were tried and forecast for every principal, and of their scenes.
    common_scores
        Each principal's :data:`PRINCIPAL_MEASURES` on the common instances; empty if there are
        none.
    improvement
        For each ordered pair of principals, how much better the first is in each of
        :data:`PRINCIPAL_MEASURES`.
    settings
        Of :func:`compare`.
    views
        By principal, what further views are worth; empty if only single views were compared.
    """

    gripper: str
    estimators: tuple[str, ...]
    principals: Mapping[str, SupporterComparison]
    common: int
    scenes: int
    common_scores: Mapping[str, Mapping[str, float]]
    improvement: Mapping[tuple[str, str], Mapping[str, Interval]]
    settings: Mapping[str, Any]
    views: Mapping[str, ViewWorth] = field(default_factory=dict)

    @property
    def ranking(self) -> tuple[str, ...]:
        """Principals by AURC on the common instances, the best first."""
        scores = self.common_scores
        return tuple(sorted(scores, key=lambda name: scores[name][CRITERION]))

    def as_dict(self) -> dict[str, Any]:
        """Return plain numbers, for JSON; NaN becomes None."""
        principals = {}
        for name, found in self.principals.items():
            principals[name] = asdict(found)
            del principals[name]["principal"]
        improvement: dict[str, dict[str, Any]] = {name: {} for name in self.common_scores}
        for (better, worse), measures in self.improvement.items():
            improvement[better][worse] = {name: asdict(each) for name, each in measures.items()}
        out = {
            "gripper": self.gripper,
            "estimators": list(self.estimators),
            "principals": principals,
            "common": {
                "n": self.common,
                "scenes": self.scenes,
                "scores": self.common_scores,
                "improvement": improvement,
            },
            "settings": self.settings,
        }
        if self.views:
            out["views"] = {name: each.as_dict() for name, each in self.views.items()}
        return {name: _without_nan(value) for name, value in out.items()}


@checked(
    training_data=sequence(a(TrainingData)),
    models=mapping(a(Models), "dataset"),
    views=mapping(a(PrincipalViews), "principal"),
)
def compare(
    training_data: Sequence[TrainingData],
    *,
    models: Mapping[str, Models] | None = None,
    forests: ForestSettings | None = None,
    folds: int = 5,
    seed: int = 0,
    bootstrap: int = 1000,
    views: Mapping[str, PrincipalViews] | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """Compare principals, and sets of supporters of each; and, with views, further views.

    Without a supporter, forecasts lack its poses and the outcomes of grasps that it guided.

    Parameters
    ----------
    training_data
        Of each principal that has outcomes, with the same estimators and one gripper.
    models
        Dataset's name to its object models.
    forests
        Settings of the forecasters; by default 64 trees without calibration, which would train each
        forecaster several times.
    folds
        Number of folds of scenes.
    seed
        Of the folds and of the bootstrap.
    bootstrap
        Number of draws of scenes.
    views
        Of each principal (:func:`~graspcast.evaluation.principal_views.fuse_principals`); None
        compares single views alone.
    progress
        Called with the share that is done, from 0 to 1, and a short message.

    Raises
    ------
    InputError
        For no training data, fewer than two folds or one draw, or too little data to train.
    MismatchError
        If training data have different estimators or grippers, two have the same principal, or
        there are fewer scenes than folds.
    """
    _check(training_data, folds, bootstrap)
    if views and (missing := [d.principal for d in training_data if d.principal not in views]):
        raise MismatchError(f"there are fused views, but none of {', '.join(missing)}")
    forests = forests or ForestSettings(trees=64, folds=0, seed=seed)
    options: dict[str, Any] = {"models": models, "forests": forests, "folds": folds, "seed": seed}
    steps = 2 if views else 1
    first = step_of(progress, 0, steps)
    candidates = forecast_principals(training_data, progress=first, **options)
    worth = {}
    for i, data in enumerate(training_data if views else ()):
        step = step_of(step_of(progress, 1, steps), i, len(training_data))
        given = (data, (views or {})[data.principal], candidates[i])
        found = view_forecasts(*given, progress=step, **options)
        worth[data.principal] = worth_of_views(found, bootstrap, seed)
    common = common_rows(candidates)
    drawn: dict[str, ScoreDraws] = {}
    scenes = 0
    if len(common[0]):
        # Blocks of frames are cut for each principal separately; to be paired, all use the first's.
        groups = candidates[0].full.scenes[common[0]]
        scenes = len(np.unique(groups))
        for each, rows in zip(candidates, common, strict=True):
            shared = replace(each.full.select(rows), scenes=groups)
            drawn[each.principal] = bootstrap_scores(shared, PRINCIPAL_MEASURES, bootstrap, seed)
    return Comparison(
        gripper=training_data[0].gripper,
        estimators=training_data[0].estimates.estimators,
        principals={
            each.principal: _compare_supporters(each, bootstrap, seed) for each in candidates
        },
        common=len(common[0]),
        scenes=scenes,
        common_scores={name: original_scores(scores) for name, scores in drawn.items()},
        improvement={
            (one, other): improvements(drawn[one], drawn[other])
            for one in drawn
            for other in drawn
            if one != other
        },
        settings={
            "folds": folds,
            "seed": seed,
            "bootstrap": bootstrap,
            "forests": asdict(forests),
        },
        views=worth,
    )


def _check(training_data: Sequence[TrainingData], folds: int, bootstrap: int) -> None:
    if not training_data or folds < 2 or bootstrap < 1:
        raise InputError(
            f"{len(training_data)} principals, {folds} folds, {bootstrap} draws: at least one "
            "principal with outcomes, two folds and one draw are needed",
            parameters=("outcomes", "folds", "bootstrap"),
        )
    first = training_data[0]
    principals = [each.principal for each in training_data]
    for each in training_data:
        if (each.gripper, each.estimates.estimators) != (first.gripper, first.estimates.estimators):
            raise MismatchError(
                f"training data of {first.principal} have {', '.join(first.estimates.estimators)} "
                f"and the {first.gripper} gripper, but those of {each.principal} have "
                f"{', '.join(each.estimates.estimators)} and the {each.gripper} gripper"
            )
        if principals.count(each.principal) > 1:
            raise MismatchError(f"there are two training data of {each.principal}")


def _compare_supporters(
    found: PrincipalForecasts, bootstrap: int, seed: int
) -> SupporterComparison:
    """Score all sets of supporters, and compare each with all supporters."""
    drawn = {
        names: bootstrap_scores(forecasts, FORECAST_MEASURES, bootstrap, seed)
        for names, forecasts in found.forecasts.items()
    }
    full = drawn[found.supporters]

    def difference(names: tuple[str, ...]) -> PairedDifference:
        return PairedDifference(original_scores(drawn[names]), improvements(full, drawn[names]))

    several = found.supporters if len(found.supporters) > 1 else ()
    others = {name: tuple(n for n in found.supporters if n != name) for name in several}
    return SupporterComparison(
        principal=found.principal,
        n=len(found.full),
        without_forecast=found.without_forecast,
        scenes=len(np.unique(found.full.scenes)),
        success_rate=float(found.full.success.mean()),
        scores=original_scores(full),
        without={name: difference(names) for name, names in others.items()},
        alone={name: difference((name,)) for name in several},
    )


def _without_nan(value: Any) -> Any:
    """Return nested dictionaries with None for NaN, which JSON does not have."""
    if isinstance(value, Mapping):
        return {key: _without_nan(each) for key, each in value.items()}
    return None if isinstance(value, float) and np.isnan(value) else value
