"""From K estimators' poses of an instance to the probability that its grasp holds."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast._version import __version__
from graspcast.bop.models import Models
from graspcast.consensus import FeatureSet, consensus_features, mean_add
from graspcast.errors import FormatError, InputError, MismatchError, UnknownNameError
from graspcast.estimates import Estimates
from graspcast.files import atomic_write
from graspcast.learning.predictors import (
    UNSEEN,
    NetworkEnsemble,
    NetworkSettings,
    Predictor,
    Thresholds,
)
from graspcast.learning.samples import Samples, by_object, by_scene
from graspcast.learning.scores import Scores, score
from graspcast.verdict import Verdict, check_threshold, decide

__all__ = ["METHODS", "Card", "Forecaster", "cross_validate", "train_forecaster"]

METHODS = ("threshold", "MLP", "MLP-O")
_FORMAT = 1


@dataclass(frozen=True)
class Card:
    """What a forecaster was made of.

    Attributes:
        principal, supporters: The estimators; features are in the supporters' order.
        gripper: The gripper whose outcomes it learned.
        objects: ``dataset-number`` of the objects it knows.
        method: One of :data:`METHODS`.
        features: Feature set (``paper`` or ``rich``), or ``add`` for the threshold.
        settings: Of the method.
        samples, success_rate: Of the training data.
        data: SHA-256 of the training data.
        versions: Of graspcast, Python and NumPy.
        scores: Cross-validated scores by protocol.
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

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class Forecaster:
    """A trained predictor and its card.

    ::

        forecaster = Forecaster.load("model.npz")
        verdict = forecaster.predict({"epos": cam_T_a, "gdrnpp": cam_T_b}, "lmo-1")
        if verdict.attempt: ...
    """

    card: Card
    predictor: Predictor

    @property
    def needs_models(self) -> bool:
        """Whether its features need object models."""
        return self.card.features != "paper"

    def probability(
        self,
        estimates: Estimates,
        models: Mapping[str, Models] | None = None,
        *,
        unseen_objects: bool = False,
    ) -> Float[ndarray, "n"]:
        """Probability of success of every instance.

        Args:
            estimates: Poses by (at least) the principal and the supporters.
            models: Dataset's name to its object models, if :attr:`needs_models`.
            unseen_objects: Answer for objects that it was not trained for too, if it can.

        Raises:
            MismatchError: for other estimators or objects than it was trained for.
        """
        card = self.card
        self._check_estimators(estimates.estimators)
        values = _features(estimates.only(card.principal, *card.supporters), card, models)
        return self.predictor.probability(
            values, self._object_numbers(estimates.objects, unseen_objects)
        )

    def predict(
        self,
        poses: Mapping[str, Float[ndarray, "4 4"]],
        object_name: str,
        *,
        threshold: float = 0.5,
        models: Mapping[str, Models] | None = None,
    ) -> Verdict:
        """The verdict on one instance.

        Args:
            poses: Estimator's name to its ``cam_T_obj``, metres.
            object_name: ``dataset-number``, as in ``lmo-1``.
            threshold: Attempt at this probability or above it.
            models: As for :meth:`probability`.

        Raises:
            MismatchError: for other estimators or objects than it was trained for.
            InputError: for a pose that is not one, or a threshold that is no probability.
        """
        check_threshold(threshold)
        self._check_estimators(poses)
        self._object_numbers(np.array([object_name]))
        dataset, _, number = object_name.rpartition("-")
        for name, pose in poses.items():
            if np.shape(pose) != (4, 4) or not np.isfinite(pose).all():
                raise InputError(f"the pose by {name} is not a 4x4 matrix of finite numbers")
        one = np.zeros(1, dtype=np.int64)
        estimates = Estimates(
            estimators=tuple(poses),
            dataset=np.array([dataset]),
            scene_id=one,
            im_id=one,
            obj_id=one + int(number),
            inst_id=one,
            cam_T_obj=np.stack([np.asarray(p, np.float64)[None] for p in poses.values()]),
        )
        return decide(float(self.probability(estimates, models)[0]), threshold)

    def _check_estimators(self, given: Collection[str]) -> None:
        card = self.card
        lacking = [name for name in (card.principal, *card.supporters) if name not in given]
        if lacking:
            raise MismatchError(
                f"this model needs estimates by {card.principal} (principal) and "
                f"{', '.join(card.supporters)}, but there are none by {', '.join(lacking)}; "
                f"given: {', '.join(given) or 'none'}"
            )

    def _object_numbers(self, names: ndarray, unseen: bool = False) -> ndarray:
        number = {name: i for i, name in enumerate(self.card.objects)}
        strange = sorted(set(names.tolist()) - set(number))
        if strange and not unseen:
            raise MismatchError(
                f"this model was not trained for {', '.join(strange)}; it knows "
                f"{', '.join(self.card.objects)}; leave the others out with --objects"
            )
        return np.array([number.get(name, UNSEEN) for name in names.tolist()], dtype=np.int64)

    def save(self, path: str | PathLike[str]) -> None:
        """Write it as one file: arrays and JSON in an npz, no pickle."""
        content = {"format": _FORMAT, "card": self.card.as_dict()}
        with atomic_write(path) as temporary, temporary.open("wb") as stream:
            np.savez_compressed(
                stream, card=np.array(json.dumps(content)), **_prefixed(self.predictor.to_arrays())
            )

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Forecaster:
        """Read what :meth:`save` wrote.

        Raises:
            FormatError: if the file is missing, truncated, or no model.
        """
        path = Path(path)
        try:
            # Opened here, since NumPy leaves what is no archive open.
            with path.open("rb") as stream, np.load(stream, allow_pickle=False) as data:
                content = json.loads(str(data["card"]))
                arrays = {k.removeprefix("predictor/"): data[k] for k in data.files if k != "card"}
            if content["format"] != _FORMAT:
                raise FormatError(path, f"is a model of format {content['format']}, not {_FORMAT}")
            card = _card(content["card"])
            kind = Thresholds if card.method == "threshold" else NetworkEnsemble
            return cls(card, kind.from_arrays(arrays))
        except FormatError:
            raise
        except OSError as error:
            raise FormatError(path, f"cannot be read ({error.strerror or error})") from error
        except Exception as error:  # those of zipfile, zlib, tokenize and NumPy have no common base
            raise FormatError(
                path, f"is not a whole model file ({error}); train it again"
            ) from error


def _prefixed(arrays: Mapping[str, ndarray]) -> dict[str, Any]:
    return {f"predictor/{name}": array for name, array in arrays.items()}


def _card(content: Mapping[str, Any]) -> Card:
    lists = {k: tuple(content[k]) for k in ("supporters", "objects")}
    return Card(**{**content, **lists})


def _features(
    estimates: Estimates, card: Card, models: Mapping[str, Models] | None
) -> Float[ndarray, "n d"]:
    if card.features == "add":
        return mean_add(estimates, card.principal, models or {})[:, None]
    which: FeatureSet = "rich" if card.features == "rich" else "paper"
    return consensus_features(estimates, card.principal, which=which, models=models).values


def _digest(samples: Samples) -> str:
    estimates = samples.estimates
    digest = hashlib.sha256()
    for part in ("dataset", "scene_id", "im_id", "obj_id", "inst_id", "cam_T_obj"):
        digest.update(np.ascontiguousarray(getattr(estimates, part)).tobytes())
    digest.update(samples.success.tobytes())
    return digest.hexdigest()


def _fit(
    values: ndarray,
    samples: Samples,
    objects: ndarray,
    method: str,
    settings: NetworkSettings,
    progress: Callable[[float], None] | None,
) -> Predictor:
    if method == "threshold":
        return Thresholds.fit(values, samples.success, objects)
    return NetworkEnsemble.fit(values, samples.success, objects, settings, progress=progress)


def train_forecaster(
    samples: Samples,
    *,
    method: str = "MLP-O",
    features: FeatureSet = "paper",
    settings: NetworkSettings | None = None,
    models: Mapping[str, Models] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Forecaster:
    """Train a forecaster for the samples' principal, supporters, gripper and objects.

    Args:
        samples: Instances with outcomes.
        method: ``threshold`` (on ADD), ``MLP`` (networks for each object) or ``MLP-O`` (for all).
        features: ``paper`` or ``rich``; the threshold has its own.
        settings: Of the networks.
        models: Dataset's name to its object models, for ``rich`` and the threshold.
        progress: Called with the share of the work that is done.

    Raises:
        UnknownNameError: for an unknown method.
        InputError: for fewer than ten samples, or only successes or only failures.
    """
    if method not in METHODS:
        raise UnknownNameError("method", method, METHODS)
    held = int(samples.success.sum())
    if len(samples) < 10 or held in (0, len(samples)):
        raise InputError(
            f"{len(samples)} samples with {held} successes are too few to learn from: give at "
            "least ten, with both outcomes"
        )
    settings = replace(
        settings or NetworkSettings(),
        pools_objects=method == "MLP-O",
        standardise=features == "rich",
    )
    names = tuple(sorted(set(samples.objects.tolist())))
    card = Card(
        principal=samples.principal,
        supporters=samples.estimates.supporters(samples.principal),
        gripper=samples.gripper,
        objects=names,
        method=method,
        features="add" if method == "threshold" else features,
        settings={} if method == "threshold" else asdict(settings),
        samples=len(samples),
        success_rate=held / len(samples),
        data=_digest(samples),
        versions={
            "graspcast": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
        },
    )
    values = _features(samples.estimates, card, models)
    objects = np.searchsorted(names, samples.objects)
    return Forecaster(card, _fit(values, samples, objects, method, settings, progress))


def cross_validate(
    samples: Samples,
    *,
    by: Literal["scene", "object"] = "scene",
    folds: int = 5,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    **options: Any,
) -> Scores:
    """Scores on scenes (or blocks of frames), or on objects, that training has not seen.

    Args:
        samples: Instances with outcomes.
        by: Deal out the scenes, or leave out each object in turn.
        folds: How many parts the scenes are dealt into.
        seed: Of the dealing.
        progress: Called with the share of the work that is done.
        options: Those of :func:`train_forecaster`.
    """
    probability = np.full(len(samples), np.nan)
    if by == "scene":
        parts = list(by_scene(samples, folds=folds, seed=seed))
    else:
        parts = [fold for _, fold in by_object(samples)]
    for i, (train, test) in enumerate(parts):

        def step(share: float, i: int = i) -> None:
            if progress is not None:
                progress((i + share) / len(parts))

        forecaster = train_forecaster(samples.select(train), progress=step, **options)
        if by == "scene":
            test = test[np.isin(samples.objects[test], forecaster.card.objects)]
        if not len(test):
            continue
        probability[test] = forecaster.probability(
            samples.estimates.select(test), options.get("models"), unseen_objects=by == "object"
        )
    scored = ~np.isnan(probability)
    return score(probability[scored], samples.success[scored], samples.objects[scored])
