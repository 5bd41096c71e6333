"""Targets: the grasps of each object that a forecaster knows, numbered."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.estimates.outcomes import REFERENCE_GRASP
from graspcast.forecasting.models.encoding import UNSEEN
from graspcast.io.cached import cached_property

__all__ = ["Targets"]


@dataclass(frozen=True)
class Targets:
    """The grasps of each object, numbered object by object, and sorted by name within each.

    Where every object has the reference grasp alone, the numbers are those of the objects.

    Attributes
    ----------
    objects
        Names of the objects.
    grasps
        Names of the grasps of each object, sorted.
    """

    objects: tuple[str, ...]
    grasps: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, pairs: Iterable[tuple[str, str]]) -> Targets:
        """Return the targets of pairs of an object and a grasp."""
        named: dict[str, set[str]] = {}
        for name, grasp in pairs:
            named.setdefault(name, set()).add(grasp)
        objects = tuple(sorted(named))
        return cls(objects, tuple(tuple(sorted(named[name])) for name in objects))

    @classmethod
    def of_objects(cls, objects: Sequence[str]) -> Targets:
        """Return the targets of objects that have the reference grasp alone."""
        return cls(tuple(objects), ((REFERENCE_GRASP,),) * len(objects))

    def __len__(self) -> int:
        return sum(map(len, self.grasps))

    @property
    def has_several(self) -> bool:
        """Whether there is any grasp but the reference grasp."""
        return any(names != (REFERENCE_GRASP,) for names in self.grasps)

    @cached_property
    def first(self) -> list[int]:
        """The number of each object's first grasp."""
        counts = [0, *map(len, self.grasps)]
        return np.cumsum(counts)[:-1].tolist()

    @cached_property
    def _number(self) -> dict[tuple[str, str], int]:
        pairs = [(o, g) for o, names in zip(self.objects, self.grasps, strict=True) for g in names]
        return {pair: i for i, pair in enumerate(pairs)}

    def numbers(self, objects: Iterable[str], grasp: str) -> Int[ndarray, " n"]:
        """Return the number of the grasp of this name for each object, -1 where it has none."""
        known = self._number
        return np.array([known.get((name, grasp), UNSEEN) for name in objects], dtype=np.int64)

    @property
    def object_numbers(self) -> Int[ndarray, " t"]:
        """The number of each target's object, (T,)."""
        return np.repeat(np.arange(len(self.objects)), [len(names) for names in self.grasps])

    def any_of(self, which: Bool[ndarray, " t"]) -> Bool[ndarray, " o"]:
        """Find the objects of which any target is among some, (O,)."""
        return np.bincount(self.object_numbers[which], minlength=len(self.objects)) > 0

    def codes(self) -> Float[ndarray, "t c"]:
        """Return the inputs that tell a forest which target a row is of.

        These are the object's one-hot vector and, if any object has several grasps, that of the
        grasp's place among those of its object. So what grasps of an object have in common is
        learned from all of them.
        """
        code = np.eye(len(self.objects))[self.object_numbers]
        if not self.has_several:
            return code
        place = np.concatenate([np.arange(len(names)) for names in self.grasps])
        return np.concatenate([code, np.eye(int(place.max()) + 1)[place]], axis=1)
