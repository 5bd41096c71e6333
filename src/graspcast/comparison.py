"""Which estimator should be the principal, and what each supporter is worth, by cross-validation.

Every forecast compared here is of a scene that its forecaster has not seen. Differences are paired:
the same instances, forecast in two ways, under the same draws of scenes with replacement (cluster
bootstrap: Davison & Hinkley, *Bootstrap Methods and their Application*, 1997, 3.8), since instances
of one scene are not independent. What decides is the area under the risk-coverage curve: the share
of attempts that fail, averaged over all attempt rates. The other measures stand beside it, but one
had to be fixed beforehand, lest the data choose the one that pleases.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import InputError, MismatchError
from graspcast.learning.blend import ForestSettings
from graspcast.learning.lessons import Lessons
from graspcast.learning.samples import scene_groups
from graspcast.learning.scores import score
from graspcast.learning.training import cross_validated

__all__ = [
    "DECISIVE",
    "FORECAST",
    "STANDING",
    "Comparison",
    "Contrast",
    "Gain",
    "Judged",
    "compare",
]

_ATTEMPTED = ("success_at_50", "success_at_70", "success_at_90")
FORECAST = ("aurc", "auroc", "brier", *_ATTEMPTED)
"""Measures of what supporters are worth."""
STANDING = ("aurc", *_ATTEMPTED, "success")
"""Measures of what grasps a principal guides; all attempted is the last."""
DECISIVE = "aurc"
"""The measure by which the recommendation is made."""
_LOWER_IS_BETTER = ("aurc", "brier")
_LEVEL = (2.5, 97.5)

Drawn = dict[str, Float[ndarray, "b"]]
"""Of each measure its value, and then its value under each draw of scenes."""


@dataclass(frozen=True)
class Gain:
    """By how much something is better than something else: positive is better in every measure.

    Attributes:
        value: The difference.
        low, high: Its 95 % interval; NaN where there are no two scenes to draw.
    """

    value: float
    low: float
    high: float

    @property
    def distinct(self) -> bool:
        """Whether zero lies outside the interval."""
        return self.low > 0 or self.high < 0

    def __str__(self) -> str:
        return f"{self.value:+.3f} [{self.low:+.3f}, {self.high:+.3f}]"


@dataclass(frozen=True)
class Contrast:
    """Forecasts with some of the supporters, and how much better they are with all.

    Attributes:
        figures: Each of :data:`FORECAST`.
        gain: By how much all supporters do better than these.
    """

    figures: Mapping[str, float]
    gain: Mapping[str, Gain]


@dataclass(frozen=True)
class Judged:
    """What is known of one principal and its supporters.

    Attributes:
        principal: Its name.
        n: Instances with an outcome and forecasts.
        unjudged: Instances whose object no other scene had, so that there is no forecast.
        scenes: Scenes (or blocks of frames) that they are of.
        success: Success rate when every estimate is attempted.
        figures: Each of :data:`FORECAST`, with all supporters.
        without: For each supporter, forecasts by the others; empty where there is only one.
        alone: For each supporter, forecasts by it alone; empty where there is only one.
    """

    principal: str
    n: int
    unjudged: int
    scenes: int
    success: float
    figures: Mapping[str, float]
    without: Mapping[str, Contrast]
    alone: Mapping[str, Contrast]


@dataclass(frozen=True)
class Comparison:
    """The answer of :func:`compare`.

    Attributes:
        gripper: Whose outcomes they are.
        estimators: All estimators.
        principals: Those that have outcomes.
        common, scenes: Instances that were tried and forecast for every one of them, and how many
            scenes these are of.
        standings: Each principal's :data:`STANDING` on the common instances; empty if there are
            none.
        ahead: For each ordered pair of principals by how much the first is better, in each of
            :data:`STANDING`.
        settings: With what it was computed.
    """

    gripper: str
    estimators: tuple[str, ...]
    principals: Mapping[str, Judged]
    common: int
    scenes: int
    standings: Mapping[str, Mapping[str, float]]
    ahead: Mapping[tuple[str, str], Mapping[str, Gain]]
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
            parts[0] += f", {by} from the next best, {others[0]}"
            tied = [name for name in others if not self.ahead[best, name][DECISIVE].distinct]
            if tied:
                parts.append(f"the difference from {' and '.join(tied)} may be chance")
        else:
            parts.append("no other principal has outcomes")
        return "; ".join([*parts, *self._worth(self.principals[best])])

    def _worth(self, judged: Judged) -> list[str]:
        if not judged.without:
            (only,) = (name for name in self.estimators if name != judged.principal)
            return [f"{only} is its only supporter, without which there is no forecast"]
        gains = {name: found.gain[DECISIVE] for name, found in judged.without.items()}
        kinds = {
            "worth having": [name for name, gain in gains.items() if gain.low > 0],
            "worth not distinguishable from zero beside the others": [
                name for name, gain in gains.items() if not gain.distinct
            ],
            "better left out": [name for name, gain in gains.items() if gain.high < 0],
        }
        return [
            f"{kind}: " + ", ".join(f"{name} ({gains[name]})" for name in names)
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
                        other: {measure: asdict(gain) for measure, gain in gains.items()}
                        for (first, other), gains in self.ahead.items()
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
    lessons: Sequence[Lessons],
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

    Args:
        lessons: Of each principal that has outcomes: the same estimators, one gripper.
        models: Dataset's name to its object models.
        forests: How forecasters are trained; by default with 64 trees, and not calibrated, which
            costs Brier scores some thousandths and saves four fifths of the time.
        folds: How many parts the scenes are dealt into.
        seed: Of dealing scenes and of drawing them.
        bootstrap: How often the scenes are drawn.
        progress: Called with the share of the work that is done.

    Raises:
        InputError: for no lessons, fewer than two folds or one draw, or lessons too few to train.
        MismatchError: if lessons are of different estimators or grippers, twice of one principal,
            or of fewer scenes than folds.
    """
    _check(lessons, folds, bootstrap)
    forests = forests or ForestSettings(trees=64, folds=0, seed=seed)
    options: dict[str, Any] = {"models": models, "forests": forests, "folds": folds, "seed": seed}
    subsets = [_subsets(each.estimates.supporters(each.principal)) for each in lessons]
    total = sum(map(len, subsets))
    done = 0
    found = []
    for learned, wanted in zip(lessons, subsets, strict=True):
        probability = {}
        for supporters in wanted:

            def step(share: float, before: int = done) -> None:
                if progress is not None:
                    progress((before + share) / total)

            kept = [
                name
                for name in learned.estimates.estimators
                if name == learned.principal or name in supporters
            ]
            probability[supporters] = cross_validated(learned.only(*kept), progress=step, **options)
            done += 1
        found.append(_Forecasts.of(learned, probability))
    common = _common(found)
    standings: dict[str, Drawn] = {}
    scenes = 0
    if len(common[0]):
        groups = found[0].groups[common[0]]
        scenes = len(np.unique(groups))
        draws = _draws(groups, bootstrap, seed)
        for each, rows in zip(found, common, strict=True):
            all_ = each.probability[each.supporters][rows]
            standings[each.principal] = _drawn(all_, each.success[rows], draws, STANDING)
    return Comparison(
        gripper=lessons[0].gripper,
        estimators=lessons[0].estimates.estimators,
        principals={each.principal: each.judged(bootstrap, seed) for each in found},
        common=len(common[0]),
        scenes=scenes,
        standings={name: _values(drawn) for name, drawn in standings.items()},
        ahead={
            (one, other): _gains(standings[one], standings[other])
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


def _check(lessons: Sequence[Lessons], folds: int, bootstrap: int) -> None:
    if not lessons or folds < 2 or bootstrap < 1:
        raise InputError(
            f"{len(lessons)} principals, {folds} folds, {bootstrap} draws: there must be at least "
            "one principal with outcomes, two folds, and one draw"
        )
    first = lessons[0]
    principals = [each.principal for each in lessons]
    for each in lessons:
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
class _Forecasts:
    """One principal's instances that every set of supporters has a forecast of."""

    principal: str
    supporters: tuple[str, ...]
    probability: Mapping[tuple[str, ...], Float[ndarray, "n"]]
    success: Bool[ndarray, "n"]
    groups: ndarray
    unjudged: int
    places: Mapping[tuple[str, int, int, int], int]
    """Dataset, scene, image and object to the row, where the image has one such instance only:
    several are numbered by the principal's scores, so that another's number means another."""

    @classmethod
    def of(
        cls, learned: Lessons, probability: Mapping[tuple[str, ...], Float[ndarray, "n"]]
    ) -> _Forecasts:
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
        several = {keys[i] for i in np.flatnonzero(estimates.inst_id > 0)}
        return cls(
            learned.principal,
            estimates.supporters(learned.principal),
            {names: found[judged] for names, found in probability.items()},
            own[rows] == 1,
            scene_groups(estimates)[rows],
            int((~judged).sum()),
            {keys[row]: i for i, row in enumerate(rows) if keys[row] not in several},
        )

    def judged(self, bootstrap: int, seed: int) -> Judged:
        """Figures with all supporters and with some, and paired differences."""
        draws = _draws(self.groups, bootstrap, seed)
        drawn = {
            names: _drawn(probability, self.success, draws, FORECAST)
            for names, probability in self.probability.items()
        }
        every = drawn[self.supporters]

        def contrast(names: tuple[str, ...]) -> Contrast:
            return Contrast(_values(drawn[names]), _gains(every, drawn[names]))

        several = self.supporters if len(self.supporters) > 1 else ()
        return Judged(
            self.principal,
            len(self.success),
            self.unjudged,
            len(np.unique(self.groups)),
            float(self.success.mean()),
            _values(every),
            {name: contrast(tuple(n for n in self.supporters if n != name)) for name in several},
            {name: contrast((name,)) for name in several},
        )


def _common(found: Sequence[_Forecasts]) -> list[Int[ndarray, "m"]]:
    """The rows of each principal's that all principals have, in one order."""
    shared = sorted(set.intersection(*(set(each.places) for each in found)))
    return [np.array([each.places[key] for key in shared], dtype=np.int64) for each in found]


def _draws(groups: ndarray, bootstrap: int, seed: int) -> list[Int[ndarray, "m"]]:
    """Rows of scenes drawn with replacement; none where there are no two scenes."""
    names, number = np.unique(groups, return_inverse=True)
    if len(names) < 2:
        return []
    rows = [np.flatnonzero(number == i) for i in range(len(names))]
    chosen = np.random.default_rng(seed).integers(len(names), size=(bootstrap, len(names)))
    return [np.concatenate([rows[i] for i in one]) for one in chosen.tolist()]


def _drawn(
    probability: Float[ndarray, "n"],
    success: Bool[ndarray, "n"],
    draws: Sequence[Int[ndarray, "m"]],
    measures: Sequence[str],
) -> Drawn:
    together = np.zeros(len(success), dtype=np.int64)  # accuracy, over objects, is not asked for
    found = [
        score(probability[rows], success[rows], together[rows])
        for rows in (np.arange(len(success)), *draws)
    ]
    return {name: np.array([getattr(one, name) for one in found]) for name in measures}


def _values(drawn: Drawn) -> dict[str, float]:
    return {name: float(values[0]) for name, values in drawn.items()}


def _gains(mine: Drawn, other: Drawn) -> dict[str, Gain]:
    out = {}
    for name, values in mine.items():
        better = (other[name] - values) if name in _LOWER_IS_BETTER else (values - other[name])
        under = better[1:][~np.isnan(better[1:])]  # a draw with one class has no AUROC
        low, high = np.percentile(under, _LEVEL) if len(under) else (np.nan, np.nan)
        out[name] = Gain(float(better[0]), float(low), float(high))
    return out


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    return None if isinstance(value, float) and value != value else value
