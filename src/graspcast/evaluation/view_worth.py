"""What further views are worth beside further estimators, by forecasts of the same grasps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from graspcast.evaluation.bootstrap import Interval
from graspcast.evaluation.paired_differences import (
    CRITERION,
    FORECAST_MEASURES,
    ScoreDraws,
    bootstrap_scores,
    improvements,
    original_scores,
)
from graspcast.evaluation.principal_views import Seen, ViewForecasts

__all__ = ["Gain", "ViewWorth", "worth_of_views"]


@dataclass(frozen=True)
class Gain:
    """How much better one forecast is than another of the same grasps.

    Attributes
    ----------
    better, worse
        From whose estimates, and from how many views.
    improvement
        In each of :data:`FORECAST_MEASURES`; positive is better in every measure.
    """

    better: Seen
    worse: Seen
    improvement: Mapping[str, Interval]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        given = {"better": self.better, "worse": self.worse}
        sides = {side: {"estimators": list(n), "views": v} for side, (n, v) in given.items()}
        return {**sides, "improvement": {k: asdict(v) for k, v in self.improvement.items()}}


@dataclass(frozen=True)
class ViewWorth:
    """Forecasts for one principal from one view and from several, compared.

    Attributes
    ----------
    principal
        Its name. It guides every grasp by its pose from a single view.
    estimators
        All, the principal first.
    n, scenes
        Number of instances that have every number of views, and of their scenes.
    without_views
        Number of instances that have fewer.
    contradicted
        Number of views to the number of instances for which the principal alone has no forecast,
        as its views contradict each other.
    success_rate
        When every estimate is attempted.
    scores
        Each of :data:`FORECAST_MEASURES` of each forecast.
    over_one_view
        The improvement over all estimators from one view.
    instead
        Number of views v to the gain of v views of the principal alone over one view of v
        estimators, the best such set by AURC; where these were compared.
    further
        Number of views v to the gain of v views of all estimators over v - 1.
    others
        Number of views v to the gain of v views of all estimators over v of the principal alone.
    """

    principal: str
    estimators: tuple[str, ...]
    n: int
    scenes: int
    without_views: int
    contradicted: Mapping[int, int]
    success_rate: float
    scores: Mapping[Seen, Mapping[str, float]]
    over_one_view: Mapping[Seen, Mapping[str, Interval]]
    instead: Mapping[int, Gain]
    further: Mapping[int, Gain]
    others: Mapping[int, Gain]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        forecasts = [
            {
                "estimators": list(seen[0]),
                "views": seen[1],
                "scores": dict(scores),
                "improvement_over_one_view_of_all": {
                    name: asdict(each) for name, each in self.over_one_view[seen].items()
                },
            }
            for seen, scores in self.scores.items()
        ]
        gains = {"instead": self.instead, "further": self.further, "others": self.others}
        plain = ("n", "scenes", "without_views", "success_rate")
        return {
            **{name: getattr(self, name) for name in plain},
            "contradicted": {str(v): count for v, count in self.contradicted.items()},
            "forecasts": forecasts,
            **{k: {str(v): g.as_dict() for v, g in each.items()} for k, each in gains.items()},
        }


def worth_of_views(found: ViewForecasts, bootstrap: int, seed: int) -> ViewWorth:
    """Compare forecasts from several views with those from one, by the same draws of scenes.

    Parameters
    ----------
    found
        Forecasts of one principal.
    bootstrap, seed
        Number of draws of scenes, and their seed.
    """
    drawn = {
        seen: bootstrap_scores(forecasts, FORECAST_MEASURES, bootstrap, seed)
        for seen, forecasts in found.forecasts.items()
    }
    everyone = max((names for names, _ in drawn), key=len)
    alone = everyone[:1]
    numbers = sorted({views for names, views in drawn if names == alone})

    def gain(better: Seen, worse: Seen) -> Gain:
        return Gain(better, worse, improvements(drawn[better], drawn[worse]))

    first = found.forecasts[everyone, 1]
    rivals = {v: _best(drawn, v) for v in numbers}
    return ViewWorth(
        principal=everyone[0],
        estimators=everyone,
        n=len(first),
        scenes=len(np.unique(first.scenes)),
        without_views=found.without_views,
        contradicted=found.contradicted,
        success_rate=float(first.success.mean()),
        scores={seen: original_scores(each) for seen, each in drawn.items()},
        over_one_view={seen: improvements(d, drawn[everyone, 1]) for seen, d in drawn.items()},
        instead={v: gain((alone, v), rival) for v, rival in rivals.items() if rival is not None},
        further={v: gain((everyone, v), (everyone, v - 1)) for v in numbers},
        others={v: gain((everyone, v), (alone, v)) for v in numbers},
    )


def _best(drawn: Mapping[Seen, ScoreDraws], estimators: int) -> Seen | None:
    """Return the set of so many estimators that forecasts best from one view, if there is one."""
    sets = [seen for seen in drawn if seen[1] == 1 and len(seen[0]) == estimators]
    return min(sets, key=lambda seen: drawn[seen][CRITERION][0], default=None)
