"""Which estimator should be the principal, and what each supporter is worth, by cross-validation.

Every forecast compared here is of a scene that its forecaster has not seen. What decides is the
area under the risk-coverage curve: the share of attempts that fail, averaged over all attempt
rates. The other measures stand beside it, but one had to be fixed beforehand, lest the data choose
the one that pleases.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.instances import scene_groups
from graspcast.evaluation.bootstrap import Interval
from graspcast.evaluation.cross_validation import cross_validated
from graspcast.evaluation.paired_differences import (
    DECISIVE,
    FORECAST,
    STANDING,
    Drawn,
    PairedDifference,
    figures_of,
    gains,
    under_scenes,
)
from graspcast.evaluation.predictions import Forecasts
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.training_data import TrainingData

__all__ = ["Comparison", "Judged", "compare"]


@dataclass(frozen=True)
class Judged:
    """What is known of one principal and its supporters.

    Attributes
    ----------
    principal
        Its name.
    n
        Instances with an outcome and forecasts.
    unjudged
        Instances whose object no other scene had, so that there is no forecast.
    scenes
        Scenes (or blocks of frames) that they are of.
    success
        Success rate when every estimate is attempted.
    figures
        Each of :data:`FORECAST`, with all supporters.
    without
        For each supporter, forecasts by the others; empty where there is only one.
    alone
        For each supporter, forecasts by it alone; empty where there is only one.
    """

    principal: str
    n: int
    unjudged: int
    scenes: int
    success: float
    figures: Mapping[str, float]
    without: Mapping[str, PairedDifference]
    alone: Mapping[str, PairedDifference]


@dataclass(frozen=True)
class Comparison:
    """The answer of :func:`compare`.

    Attributes
    ----------
    gripper
        Whose outcomes they are.
    estimators
        All estimators.
    principals
        Those that have outcomes.
    common, scenes
        Instances that were tried and forecast for every one of them, and how many scenes these are
        of.
    standings
        Each principal's :data:`STANDING` on the common instances; empty if there are none.
    ahead
        For each ordered pair of principals by how much the first is better, in each of
        :data:`STANDING`.
    settings
        With what it was computed.
    """

    gripper: str
    estimators: tuple[str, ...]
    principals: Mapping[str, Judged]
    common: int
    scenes: int
    standings: Mapping[str, Mapping[str, float]]
    ahead: Mapping[tuple[str, str], Mapping[str, Interval]]
    settings: Mapping[str, Any]

    @property
    def ranking(self) -> tuple[str, ...]:
        """Principals on the common instances, the best first."""
        return tuple(sorted(self.standings, key=lambda name: self.standings[name][DECISIVE]))

    @property
    def recommendation(self) -> str:
        """One sentence: the principal to take, how sure that is, and what supporters are worth."""
        if not self.standings:
            names = ", ".join(self.principals)
            return (
                f"No principal can be recommended, since no instance was tried with all of {names}"
            )
        best, *others = self.ranking
        found = self.standings[best]
        rates = " / ".join(f"{found[name]:.3f}" for name in STANDING[1:])
        parts = [
            f"Take {best} as principal: over all attempt rates alike {1 - found[DECISIVE]:.3f} of "
            f"its grasps hold ({rates} at 50 / 70 / 90 / 100 % attempted)"
        ]
        if others:
            by = self.ahead[best, others[0]][DECISIVE]
            parts[0] += f", {by:+} against those of the next best, {others[0]}"
            tied = [name for name in others if not self.ahead[best, name][DECISIVE].distinct]
            if tied:
                parts.append(f"the difference from {' and '.join(tied)} may be chance")
            parts += filter(None, (self._more_at(name, best) for name in others))
        else:
            parts.append("no other principal has outcomes")
        return "; ".join([*parts, *self._worth(self.principals[best])])

    def _more_at(self, other: str, best: str) -> str:
        """At which attempt rates the lesser principal's grasps hold more often all the same."""
        mine, theirs = self.standings[best], self.standings[other]
        rates = zip(("50", "70", "90", "100"), STANDING[1:], strict=True)
        more = {rate: theirs[name] for rate, name in rates if theirs[name] > mine[name]}
        values = " / ".join(f"{value:.3f}" for value in more.values())
        return f"{other}'s hold more often at {' / '.join(more)} % ({values})" if more else ""

    def _worth(self, judged: Judged) -> list[str]:
        if not judged.without:
            (only,) = (name for name in self.estimators if name != judged.principal)
            return [f"{only} is its only supporter, without which there is no forecast"]
        by = {name: found.gain[DECISIVE] for name, found in judged.without.items()}
        kinds = {
            "worth having": [name for name, gain in by.items() if gain.low > 0],
            "worth not distinguishable from zero beside the others": [
                name for name, gain in by.items() if not gain.distinct
            ],
            "better left out": [name for name, gain in by.items() if gain.high < 0],
        }
        return [
            f"{kind}: " + ", ".join(f"{name} ({by[name]:+})" for name in names)
            for kind, names in kinds.items()
            if names
        ]

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers, for JSON; NaN becomes None."""
        principals = {}
        for name, judged in self.principals.items():
            principals[name] = asdict(judged)
            del principals[name]["principal"]
        found = {
            "gripper": self.gripper,
            "estimators": list(self.estimators),
            "principals": principals,
            "common": {
                "n": self.common,
                "scenes": self.scenes,
                "principals": self.standings,
                "ahead": {
                    name: {
                        other: {measure: asdict(gain) for measure, gain in better.items()}
                        for (first, other), better in self.ahead.items()
                        if first == name
                    }
                    for name in self.standings
                },
            },
            "recommendation": self.recommendation,
            "settings": self.settings,
        }
        return {name: _plain(value) for name, value in found.items()}


def compare(
    training_data: Sequence[TrainingData],
    *,
    models: Mapping[str, Models] | None = None,
    forests: ForestSettings | None = None,
    folds: int = 5,
    seed: int = 0,
    bootstrap: int = 1000,
    progress: Callable[[float], None] | None = None,
) -> Comparison:
    """Compare principals, and the worth of the supporters of each.

    Leaving a supporter out takes away its poses and what came of the grasps that it guided.

    Parameters
    ----------
    lessons
        Of each principal that has outcomes: the same estimators, one gripper.
    models
        Dataset's name to its object models.
    forests
        How forecasters are trained; by default with 64 trees, and not calibrated, since that would
        train each of them several times.
    folds
        How many parts the scenes are dealt into.
    seed
        Of dealing scenes and of drawing them.
    bootstrap
        How often the scenes are drawn.
    progress
        Called with the share of the work that is done.

    Raises
    ------
    InputError
        For no lessons, fewer than two folds or one draw, or lessons too few to train.
    MismatchError
        If lessons are of different estimators or grippers, twice of one principal, or of fewer
        scenes than folds.
    """
    _check(training_data, folds, bootstrap)
    forests = forests or ForestSettings(trees=64, folds=0, seed=seed)
    options: dict[str, Any] = {"models": models, "forests": forests, "folds": folds, "seed": seed}
    subsets = [_subsets(each.estimates.supporters(each.principal)) for each in training_data]
    total = sum(map(len, subsets))
    done = 0
    found = []
    for learned, wanted in zip(training_data, subsets, strict=True):
        probability = {}
        for supporters in wanted:

            def step(share: float, _: str, before: int = done) -> None:
                if progress is not None:
                    progress((before + share) / total)

            kept = [
                name
                for name in learned.estimates.estimators
                if name == learned.principal or name in supporters
            ]
            probability[supporters] = cross_validated(learned.only(*kept), progress=step, **options)
            done += 1
        found.append(_Candidate.of(learned, probability))
    common = _common(found)
    standings: dict[str, Drawn] = {}
    scenes = 0
    if len(common[0]):
        # Blocks of frames are cut for each principal alone; to be paired, all take the first's.
        groups = found[0].every.scenes[common[0]]
        scenes = len(np.unique(groups))
        for each, rows in zip(found, common, strict=True):
            shared = replace(each.every.select(rows), scenes=groups)
            standings[each.principal] = under_scenes(shared, STANDING, bootstrap, seed)
    return Comparison(
        gripper=training_data[0].gripper,
        estimators=training_data[0].estimates.estimators,
        principals={each.principal: each.judged(bootstrap, seed) for each in found},
        common=len(common[0]),
        scenes=scenes,
        standings={name: figures_of(drawn) for name, drawn in standings.items()},
        ahead={
            (one, other): gains(standings[one], standings[other])
            for one in standings
            for other in standings
            if one != other
        },
        settings={
            "folds": folds,
            "seed": seed,
            "bootstrap": bootstrap,
            "forests": asdict(forests),
        },
    )


def _check(training_data: Sequence[TrainingData], folds: int, bootstrap: int) -> None:
    if not training_data or folds < 2 or bootstrap < 1:
        raise InputError(
            f"{len(training_data)} principals, {folds} folds, {bootstrap} draws: there must be at "
            "least one principal with outcomes, two folds, and one draw"
        )
    first = training_data[0]
    principals = [each.principal for each in training_data]
    for each in training_data:
        if (each.gripper, each.estimates.estimators) != (first.gripper, first.estimates.estimators):
            raise MismatchError(
                f"lessons of {first.principal} are of {', '.join(first.estimates.estimators)} and "
                f"the {first.gripper} gripper, but those of {each.principal} of "
                f"{', '.join(each.estimates.estimators)} and the {each.gripper} gripper"
            )
        if principals.count(each.principal) > 1:
            raise MismatchError(f"there are lessons of {each.principal} twice")


def _subsets(supporters: tuple[str, ...]) -> list[tuple[str, ...]]:
    """All supporters, all but one, and one alone."""
    subsets = [supporters]
    if len(supporters) > 1:
        subsets += [tuple(n for n in supporters if n != without) for without in supporters]
        subsets += [(name,) for name in supporters]
    return list(dict.fromkeys(subsets))  # of two supporters, one without the other is it alone


@dataclass(frozen=True, eq=False)
class _Candidate:
    """One principal's instances that every set of supporters has a forecast of."""

    principal: str
    supporters: tuple[str, ...]
    forecasts: Mapping[tuple[str, ...], Forecasts]
    """By the supporters that they are made with; the instances are the same."""
    unjudged: int
    places: Mapping[tuple[str, int, int, int], int]
    """Dataset, scene, image and object to the row, where the image has one such instance only:
    several are numbered by the principal's scores, so that another's number means another."""

    @classmethod
    def of(
        cls, learned: TrainingData, probability: Mapping[tuple[str, ...], Float[ndarray, "n"]]
    ) -> _Candidate:
        estimates = learned.estimates
        own = learned.success[estimates.index(learned.principal)]
        tried = np.flatnonzero(~np.isnan(own))
        judged = ~np.isnan(np.stack(list(probability.values()))).any(axis=0)
        if not judged.any():
            raise InputError(
                f"no instance of {learned.principal} could be forecast: each object was tried in "
                "one part of the scenes alone; give outcomes of more scenes"
            )
        rows = tried[judged]
        columns = (estimates.dataset, estimates.scene_id, estimates.im_id, estimates.obj_id)
        keys = list(zip(*(column.tolist() for column in columns), strict=True))
        several = {keys[i] for i in np.flatnonzero(estimates.est_id > 0)}
        forecasts = {
            names: Forecasts(
                protocol="unseen_scenes",
                method=f"with {', '.join(names)}",
                principal=learned.principal,
                gripper=learned.gripper,
                probability=found[judged],
                success=own[rows] == 1,
                objects=estimates.objects[rows],
                scenes=scene_groups(estimates.instances)[rows],
            )
            for names, found in probability.items()
        }
        return cls(
            learned.principal,
            estimates.supporters(learned.principal),
            forecasts,
            int((~judged).sum()),
            {keys[row]: i for i, row in enumerate(rows) if keys[row] not in several},
        )

    @property
    def every(self) -> Forecasts:
        """Those with all supporters."""
        return self.forecasts[self.supporters]

    def judged(self, bootstrap: int, seed: int) -> Judged:
        """Figures with all supporters and with some, and paired differences."""
        drawn = {
            names: under_scenes(forecasts, FORECAST, bootstrap, seed)
            for names, forecasts in self.forecasts.items()
        }
        every = drawn[self.supporters]

        def contrast(names: tuple[str, ...]) -> PairedDifference:
            return PairedDifference(figures_of(drawn[names]), gains(every, drawn[names]))

        several = self.supporters if len(self.supporters) > 1 else ()
        return Judged(
            self.principal,
            len(self.every),
            self.unjudged,
            len(np.unique(self.every.scenes)),
            float(self.every.success.mean()),
            figures_of(every),
            {name: contrast(tuple(n for n in self.supporters if n != name)) for name in several},
            {name: contrast((name,)) for name in several},
        )


def _common(found: Sequence[_Candidate]) -> list[Int[ndarray, "m"]]:
    """The rows of each principal's that all principals have, in one order."""
    shared = sorted(set.intersection(*(set(each.places) for each in found)))
    return [np.array([each.places[key] for key in shared], dtype=np.int64) for each in found]


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    return None if isinstance(value, float) and value != value else value
