"""The model card: what a forecaster was trained on and how."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.errors import MismatchError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.outcomes import REFERENCE_GRASP
from graspcast.forecasting.models.encoding import UNSEEN
from graspcast.forecasting.models.targets import Targets
from graspcast.io.cached import cached_property
from graspcast.io.hashing import canonical_json, sha256

__all__ = ["ONE_VIEW_FEATURES", "ModelCard", "digest_of"]

ONE_VIEW_FEATURES = "visibility"
"""The feature set of a model that answers for one view of one estimator."""


@dataclass(frozen=True)
class ModelCard:
    """What a forecaster was trained on and how.

    Attributes
    ----------
    principal, supporters
        The estimators; features are in the supporters' order.
    gripper
        The gripper of the outcomes.
    objects
        ``dataset-number`` of the objects that it can forecast.
    simulated
        Those of them of which training had simulated trials alone.
    scenes
        ``dataset/scene`` of all training instances.
    method
        A key of :data:`graspcast.forecasting.model_file.KINDS`.
    features
        Feature set (``paper``, ``rich`` or ``full``), ``add`` for the threshold, or ``visibility``
        for one view of one estimator.
    settings
        Settings of the method.
    samples, success_rate
        Number and success rate of the outcomes of the principal's grasps.
    data
        SHA-256 of the training data.
    versions
        Of graspcast, Python and NumPy.
    scores
        Cross-validated scores by protocol.
    smallest_p_value
        The smallest novelty p-value that it can give; above 0.01 no p-value is out of distribution
        at the default level.
    diameters_m
        Diameter of each object whose model is known, metres.
    views
        With which camera noise and least parallax it was trained on several views; empty if it was
        not.
    warnings
        What limits the use of this forecaster, as text: few outcomes, a single scene.
    learned_from
        Estimators that it does not need, from whose grasps success given error was learned too, and
        how many outcomes of each.
    grasps
        Object's name to the names of its grasps, and on how many outcomes the forecasts of each
        rest; empty where objects have the reference grasp alone.
    """

    principal: str
    supporters: tuple[str, ...]
    gripper: str
    objects: tuple[str, ...]
    method: str
    features: str
    settings: dict[str, Any]
    samples: int
    success_rate: float
    data: str
    versions: dict[str, str]
    scores: dict[str, dict[str, Any]] = field(default_factory=dict)
    simulated: tuple[str, ...] = ()
    scenes: tuple[str, ...] = ()
    smallest_p_value: float = 1.0
    diameters_m: dict[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    views: dict[str, Any] = field(default_factory=dict)
    learned_from: dict[str, int] = field(default_factory=dict)
    grasps: dict[str, dict[str, int]] = field(default_factory=dict)

    @cached_property
    def targets(self) -> Targets:
        """The grasps of each object that it can forecast, numbered."""
        if not self.grasps:
            return Targets.of_objects(self.objects)
        return Targets(self.objects, tuple(tuple(sorted(self.grasps[o])) for o in self.objects))

    @cached_property
    def grasp_facts(self) -> tuple[tuple[str, int], ...]:
        """Name of each target's grasp, and on how many outcomes it rests (0 if not stated)."""
        pairs = zip(self.targets.objects, self.targets.grasps, strict=True)
        return tuple(
            (grasp, self.grasps[name][grasp] if self.grasps else 0)
            for name, grasps in pairs
            for grasp in grasps
        )

    def grasps_of(self, name: str) -> tuple[str, ...]:
        """Return the names of an object's grasps, sorted; the reference grasp's if unknown."""
        number = self._number.get(name)
        return (REFERENCE_GRASP,) if number is None else self.targets.grasps[number]

    @property
    def estimators(self) -> tuple[str, ...]:
        """All estimators that it needs, the principal first."""
        return (self.principal, *self.supporters)

    def lacking(self, given: Collection[str]) -> list[str]:
        """Return the needed estimators that are not given."""
        return [name for name in self.estimators if name not in given]

    def check_estimators(self, given: Collection[str]) -> None:
        """Raise if a needed estimator is not given.

        Raises
        ------
        MismatchError
            Naming what is needed, lacking and given.
        """
        if lacking := self.lacking(given):
            needed = [f"{self.principal} (principal)", ", ".join(self.supporters)]
            raise MismatchError(
                f"this model needs estimates by {' and '.join(filter(None, needed))}, but there "
                f"are none by {', '.join(lacking)}; given: {', '.join(given) or 'none'}",
                parameters=("estimates",),
            )

    def numbers_of(self, names: Sequence[str], unseen: bool = False) -> Int[ndarray, " n"]:
        """Return the number of each named object, in the order of training.

        Raises
        ------
        MismatchError
            For objects that are not in training, unless unseen ones are allowed.
        """
        number = self._number
        if not unseen and (unknown := sorted(set(names).difference(number))):
            raise MismatchError(
                f"this model was not trained for {', '.join(unknown)}; it knows "
                f"{', '.join(self.objects)}",
                parameters=("objects", "model"),
            )
        return np.array([number.get(name, UNSEEN) for name in names], dtype=np.int64)

    @cached_property
    def _number(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.objects)}

    def diameters_of(self, objects: ndarray) -> Float[ndarray, " n"]:
        """Return the diameters of named objects, metres, NaN where unknown, (n,)."""
        known = [self.diameters_m.get(name, np.nan) for name in objects.tolist()]
        return np.array(known, dtype=np.float64)

    @property
    def digest(self) -> str:
        """SHA-256 of all but the scores, by which certificates identify the model."""
        content = {k: v for k, v in self.as_dict().items() if k != "scores"}
        return sha256(canonical_json(content))

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> ModelCard:
        """Restore what :meth:`as_dict` returned, also from JSON.

        Raises
        ------
        ValueError
            Naming the entry that is missing, unknown or wrong.
        """
        known = [f.name for f in fields(cls)]
        content = {**{key: {} for key in _LATER}, **content}
        if set(content) != set(known):
            odd = ", ".join(sorted(set(content) ^ set(known)))
            raise ValueError(f"a model card has {', '.join(known)}; missing or unknown: {odd}")
        values = {f.name: _entry(f.name, str(f.type), content[f.name]) for f in fields(cls)}
        if values["grasps"] and sorted(values["grasps"]) != sorted(values["objects"]):
            raise ValueError("the card's grasps are of other than its objects")
        return cls(**values)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON; without :attr:`learned_from` and :attr:`grasps` if empty.

        So files and digests of models that have neither stay what they were.
        """
        return {k: v for k, v in asdict(self).items() if v or k not in _LATER}


_LATER = ("learned_from", "grasps")
"""Entries that are left out where they are empty."""


def digest_of(estimates: Estimates, *others: ndarray) -> str:
    """Return the SHA-256 of instances, poses and further arrays."""
    columns = ("dataset", "scene_id", "im_id", "obj_id", "est_id", "cam_T_obj")
    return sha256(*(getattr(estimates, name) for name in columns), *others)


def _is_count(value: Any) -> bool:
    return type(value) is int and value >= 0


def _entry(name: str, kind: str, value: Any) -> Any:
    """Return an entry of a card as its type has it; raise ValueError if it is something else."""
    if kind == "tuple[str, ...]":
        listed = isinstance(value, list | tuple) and all(isinstance(text, str) for text in value)
        if listed and len(set(value)) == len(value):
            return tuple(value)
    elif kind == "float":
        if type(value) in (int, float) and 0 <= value <= 1:
            return float(value)
    elif kind == "int":
        if _is_count(value):
            return value
    elif kind == "dict[str, int]":
        counts = list(value.values()) if isinstance(value, dict) else [-1]
        if all(map(_is_count, counts)):
            return value
    elif kind == "dict[str, dict[str, int]]":
        inner = list(value.values()) if isinstance(value, dict) else [None]
        if all(isinstance(x, dict) and x and all(map(_is_count, x.values())) for x in inner):
            return value
    elif kind == "dict[str, float]":
        numbers = list(value.values()) if isinstance(value, dict) else [0.0]
        if all(type(x) is float and 0 < x < float("inf") for x in numbers):
            return value
    elif isinstance(value, str if kind == "str" else dict):
        return value
    raise ValueError(f"the card's {name} is {value!r}")
