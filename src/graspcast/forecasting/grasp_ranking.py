"""Ranking of the grasps of an instance by their probability of success.

What can be chosen is what the forecaster has learned and the robot can reach. A grasp that rests on
fewer than ten outcomes comes after all others. Of several grasps the best is chosen for its high
forecast, which is a little too high for that very reason; so probabilities of grasps among which is
chosen are corrected (:mod:`graspcast.forecasting.models.held_out_choice`). The correction does not
change their order.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.instances import InstanceKey
from graspcast.estimates.outcomes import REFERENCE_GRASP
from graspcast.forecasting.grasp_counts import FEW_OUTCOMES
from graspcast.forecasting.model_card import ModelCard
from graspcast.forecasting.models.calibration import calibrated
from graspcast.forecasting.models.encoding import UNSEEN

__all__ = [
    "Candidates",
    "GraspForecast",
    "Ranking",
    "Reachable",
    "nothing_reachable",
    "refuse_mask",
]

Reachable: TypeAlias = (
    Collection[str]
    | Mapping[InstanceKey, Collection[str]]
    | Callable[[InstanceKey], Collection[str]]
)
"""Names of the grasps that a robot can reach: of all instances, or of each by its key."""


@dataclass(frozen=True)
class GraspForecast:
    """The forecast of one grasp of an instance.

    Attributes
    ----------
    grasp
        The grasp's name.
    probability
        Of success.
    outcomes
        On how many outcomes of this grasp it rests.
    """

    grasp: str
    probability: float
    outcomes: int

    @property
    def rests_on_few(self) -> bool:
        """Whether it rests on so few outcomes that others are preferred."""
        return self.outcomes < FEW_OUTCOMES


@dataclass(frozen=True, eq=False)
class Ranking:
    """The grasps of n instances, the best first.

    Attributes
    ----------
    grasps
        Of each instance; empty where no grasp can be chosen.
    targets
        Number of the best grasp of each instance, -1 where there is none, (n,).
    """

    grasps: list[tuple[GraspForecast, ...]]
    targets: Int[ndarray, " n"]

    @property
    def probability(self) -> Float[ndarray, " n"]:
        """Of the best grasp of each instance, NaN where there is none, (n,)."""
        return np.array([some[0].probability if some else np.nan for some in self.grasps])


@dataclass(frozen=True, eq=False)
class Candidates:
    """The grasps of n instances among which can be chosen, m in all.

    Attributes
    ----------
    card
        Of the forecaster.
    count
        Number of instances.
    row
        Of which instance each is, ascending, (m,).
    target
        Number of each (:mod:`graspcast.forecasting.models.targets`), -1 if the object is not in
        training, (m,).
    """

    card: ModelCard
    count: int
    row: Int[ndarray, " m"]
    target: Int[ndarray, " m"]

    @classmethod
    def of(
        cls,
        card: ModelCard,
        keys: Callable[[], Sequence[InstanceKey]],
        numbers: Int[ndarray, " n"],
        reachable: Reachable | None = None,
        usable: Bool[ndarray, " t"] | None = None,
    ) -> Candidates:
        """Find the grasps among which can be chosen.

        Parameters
        ----------
        card
            Of the forecaster.
        keys
            Returns the keys of the instances; called only for what is reachable.
        numbers
            Their objects' numbers, -1 for an object that is not in training.
        reachable
            What the robot can reach; everything if None.
        usable
            Which targets can be forecast; all if None.

        Raises
        ------
        UnknownNameError
            For a reachable grasp that the forecaster does not know; the known ones are listed.
        InputError
            For what is reachable given as one text, or as a mapping of other than instances.
        """
        targets = card.targets
        first, names = targets.first, targets.grasps
        rows: list[int] = []
        found: list[int] = []
        given = keys() if reachable is not None else []
        if isinstance(reachable, Mapping):
            _check_keys(reachable)
        if reachable is not None and not (isinstance(reachable, Mapping) or callable(reachable)):
            _checked(reachable, "grasp", sorted({name for some in names for name in some}))
        for i, number in enumerate(numbers.tolist()):
            if number == UNSEEN:
                rows.append(i)
                found.append(UNSEEN)
                continue
            every: Sequence[int] = range(first[number], first[number] + len(names[number]))
            if reachable is not None:
                mine = _names_of(reachable, given[i], names[number])
                every = [t for t, name in zip(every, names[number], strict=True) if name in mine]
            rows.extend([i] * len(every))
            found.extend(every)
        row, target = np.array(rows, dtype=np.int64), np.array(found, dtype=np.int64)
        if usable is not None:
            kept = (target == UNSEEN) | usable[target]
            row, target = row[kept], target[kept]
        return cls(card, len(numbers), row, target)

    def ranking(
        self, probability: Float[ndarray, " m"], choice: Float[ndarray, "2"] | None
    ) -> Ranking:
        """Rank by forecasts.

        Parameters
        ----------
        probability
            Of each candidate, as if it were the only one.
        choice
            Slope and intercept of the correction where there are several, or None.
        """
        known = np.flatnonzero(~np.isnan(probability))
        several = np.bincount(self.row[known], minlength=self.count)[self.row] > 1
        p = probability
        if choice is not None and several.any():
            p = np.where(several, calibrated(probability, choice), probability)
        some: list[list[tuple[bool, float, str, int, int]]] = [[] for _ in range(self.count)]
        facts = [*self.card.grasp_facts, (REFERENCE_GRASP, 0)]  # at -1 an unseen object's
        for i in known.tolist():
            target = int(self.target[i])
            name, outcomes = facts[target]
            few = bool(self.card.grasps) and outcomes < FEW_OUTCOMES
            some[int(self.row[i])].append((few, -float(p[i]), name, outcomes, target))
        for each in some:
            each.sort()
        return Ranking(
            [tuple(GraspForecast(name, -p, n) for _, p, name, n, _ in each) for each in some],
            np.array([each[0][-1] if each else UNSEEN for each in some], dtype=np.int64),
        )


def refuse_mask(reachable: Reachable | None) -> None:
    """Raise if not all grasps can be chosen, where a certificate is of choosing among all.

    Raises
    ------
    MismatchError
        If something is said to be reachable.
    """
    if reachable is not None:
        raise MismatchError(
            "the certificate is of choosing among all grasps, so it guarantees nothing where only "
            "some are reachable: leave out what is reachable, or the certificate",
            parameters=("reachable", "certificate"),
        )


def nothing_reachable(card: ModelCard, name: str) -> str:
    """Say that no grasp of an object that the forecaster knows can be reached."""
    known = ", ".join(card.grasps_of(name))
    return f"no grasp is reachable of those that the model knows of {name}: {known}"


def _names_of(reachable: Reachable, key: InstanceKey, known: tuple[str, ...]) -> Collection[str]:
    """Return the names of the grasps of one instance that can be reached."""
    if callable(reachable):
        names = reachable(key)
    elif isinstance(reachable, Mapping):
        names = reachable.get(key, ())
    else:
        return reachable
    return _checked(names, f"grasp of {key.object}", known)


def _check_keys(reachable: Mapping[InstanceKey, Collection[str]]) -> None:
    """Raise unless the first key of a mapping, and so surely all, is that of an instance."""
    key = next(iter(reachable), None)
    if key is not None and not (isinstance(key, tuple) and len(key) == len(InstanceKey._fields)):
        raise InputError(
            f"a mapping of reachable grasps has keys of instances, InstanceKey"
            f"({', '.join(InstanceKey._fields)}), not {key!r}; for all instances alike give the "
            "names alone",
            parameters=("reachable",),
        )


def _checked(names: Collection[str], kind: str, known: Sequence[str]) -> Collection[str]:
    """Return names of grasps, if they are known ones."""
    if isinstance(names, str) or not isinstance(names, Collection):
        raise InputError(
            f"reachable grasps are a collection of names, not {names!r}", parameters=("reachable",)
        )
    for name in names:
        if name not in known:
            raise UnknownNameError(kind, name, known, parameters=("reachable",))
    return names
