"""From K estimators' poses of an instance to the probability that its grasp holds."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from itertools import repeat
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import FormatError, InputError, MismatchError
from graspcast.estimates.alignment import Estimates
from graspcast.forecasting.attribution import attributions
from graspcast.forecasting.features import (
    Features,
    features_of,
)
from graspcast.forecasting.model_card import ModelCard
from graspcast.forecasting.models.add_threshold import Thresholds
from graspcast.forecasting.models.base import Predictor
from graspcast.forecasting.models.blend import Blend
from graspcast.forecasting.models.encoding import UNSEEN
from graspcast.forecasting.models.mlp.ensemble import NetworkEnsemble
from graspcast.forecasting.novelty import Novelty
from graspcast.forecasting.verdict import OOD_ALPHA, Verdict, check_threshold, decide
from graspcast.io.files import atomic_write

__all__ = ["KINDS", "Forecaster"]

KINDS: Mapping[str, Any] = {
    "blend": Blend,
    "two-stage": Blend,
    "direct": Blend,
    "threshold": Thresholds,
    "MLP": NetworkEnsemble,
    "MLP-O": NetworkEnsemble,
}
"""Method's name to what is inside a forecaster of it."""
_FORMAT = 3


@dataclass(frozen=True, eq=False)
class Forecaster:
    """A trained predictor, what training looked like, and its card.

    ::

        forecaster = Forecaster.load("model.npz")
        verdict = forecaster.predict({"epos": cam_T_a, "gdrnpp": cam_T_b}, "lmo-1")
        if verdict.attempt: ...
    """

    card: ModelCard
    predictor: Predictor
    novelty: Novelty
    typical: Float[ndarray, "d"]
    """Medians of the training features, which explanations compare with."""

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

        Parameters
        ----------
        estimates
            Poses by (at least) the principal and the supporters.
        models
            Dataset's name to its object models, if :attr:`needs_models`.
        unseen_objects
            Answer for objects that it was not trained for too, if it can.

        Raises
        ------
        MismatchError
            For other estimators or objects than it was trained for.
        """
        found, numbers = self._inputs(estimates, models, unseen_objects)
        return self.predictor.probability(found.values, numbers)

    def p_value(self, estimates: Estimates) -> Float[ndarray, "n"]:
        """How usual each instance's disagreement is (see :mod:`graspcast.forecasting.novelty`).

        Small is strange: of instances from scenes like the training's, at most a share ``a`` has
        ``a`` or less.

        Raises
        ------
        MismatchError
            For other estimators than it was trained for.
        """
        self._check_estimators(estimates.estimators)
        return self.novelty.p_value(estimates, self.card.principal, self.card.supporters)

    def explain(
        self, estimates: Estimates, models: Mapping[str, Models] | None = None
    ) -> list[tuple[tuple[str, float], ...]]:
        """What moved each probability most, and by how much, the strongest first.

        A group of features (one supporter's rotation, say) is set to training's medians; the
        probability less the one that is then forecast is what the group did.

        Raises
        ------
        MismatchError
            As :meth:`probability`.
        """
        return attributions(self.predictor, *self._inputs(estimates, models), self.typical)

    def verdicts(
        self,
        estimates: Estimates,
        models: Mapping[str, Models] | None = None,
        *,
        threshold: float | None = 0.5,
        guarantee: str | None = None,
        ood_alpha: float = OOD_ALPHA,
        explain: bool = False,
    ) -> list[Verdict]:
        """The verdict on every instance.

        Parameters
        ----------
        estimates, models
            As for :meth:`probability`.
        threshold
            Attempt at this probability or above it; None attempts nothing.
        promise
            What the threshold was certified to keep.
        strange
            Abstain where :meth:`p_value` is this or less; 0 attempts the unfamiliar too.
        explain
            Say what moved the probability (see :meth:`explain`).

        Raises
        ------
        MismatchError
            As :meth:`probability`.
        """
        found, numbers = self._inputs(estimates, models)
        attribution: Iterable[tuple[tuple[str, float], ...]] = repeat((), len(estimates))
        if explain:
            attribution = attributions(self.predictor, found, numbers, self.typical)
        return [
            decide(
                p,
                threshold,
                guarantee=guarantee,
                p_value=usual,
                ood_alpha=ood_alpha,
                attribution=why,
            )
            for p, usual, why in zip(
                self.predictor.probability(found.values, numbers).tolist(),
                self.p_value(estimates).tolist(),
                attribution,
                strict=True,
            )
        ]

    def predict(
        self,
        poses: Mapping[str, Float[ndarray, "4 4"]],
        object_name: str,
        *,
        threshold: float = 0.5,
        models: Mapping[str, Models] | None = None,
        ood_alpha: float = OOD_ALPHA,
        explain: bool = False,
    ) -> Verdict:
        """The verdict on one instance.

        Parameters
        ----------
        poses
            Estimator's name to its ``cam_T_obj``, metres.
        object_name
            ``dataset-number``, as in ``lmo-1``.
        threshold
            Attempt at this probability or above it.
        models
            As for :meth:`probability`.
        strange, explain
            As for :meth:`verdicts`.

        Raises
        ------
        MismatchError
            For other estimators or objects than it was trained for.
        InputError
            For a pose that is not one, or a threshold that is no probability.
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
            est_id=one,
            cam_T_obj=np.stack([np.asarray(p, np.float64)[None] for p in poses.values()]),
        )
        (verdict,) = self.verdicts(
            estimates, models, threshold=threshold, ood_alpha=ood_alpha, explain=explain
        )
        return verdict

    def _inputs(
        self, estimates: Estimates, models: Mapping[str, Models] | None, unseen: bool = False
    ) -> tuple[Features, ndarray]:
        """What the predictor sees: each instance's features, and its object's number."""
        card = self.card
        self._check_estimators(estimates.estimators)
        mine = estimates.only(*card.estimators)
        found = features_of(mine, card.principal, card.features, models)
        return found, self._object_numbers(estimates.objects, unseen)

    def _check_estimators(self, given: Collection[str]) -> None:
        card = self.card
        if lacking := card.lacking(given):
            raise MismatchError(
                f"this model needs estimates by {card.principal} (principal) and "
                f"{', '.join(card.supporters)}, but there are none by {', '.join(lacking)}; "
                f"given: {', '.join(given) or 'none'}"
            )

    def _object_numbers(self, names: ndarray, unseen: bool = False) -> ndarray:
        number = {name: i for i, name in enumerate(self.card.objects)}
        unknown = sorted(set(names.tolist()) - set(number))
        if unknown and not unseen:
            raise MismatchError(
                f"this model was not trained for {', '.join(unknown)}; it knows "
                f"{', '.join(self.card.objects)}; leave the others out with --objects"
            )
        return np.array([number.get(name, UNSEEN) for name in names.tolist()], dtype=np.int64)

    def save(self, path: str | PathLike[str]) -> None:
        """Write it as one file: arrays and JSON in an npz, no pickle."""
        content = {"format": _FORMAT, "card": self.card.as_dict()}
        with atomic_write(path) as temporary, temporary.open("wb") as stream:
            np.savez_compressed(
                stream,
                card=np.array(json.dumps(content)),
                typical=self.typical,
                **_prefixed("predictor", self.predictor.to_arrays()),
                **_prefixed("novelty", self.novelty.to_arrays()),
            )

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Forecaster:
        """Read what :meth:`save` wrote.

        Raises
        ------
        FormatError
            If the file is missing, truncated, or no model.
        """
        path = Path(path)
        try:
            # Opened here, since NumPy leaves what is no archive open.
            with path.open("rb") as stream, np.load(stream, allow_pickle=False) as data:
                content = json.loads(str(data["card"]))
                arrays = {k: data[k] for k in data.files if k != "card"}
            if content["format"] != _FORMAT:
                raise FormatError(path, f"is a model of format {content['format']}, not {_FORMAT}")
            card = ModelCard.from_dict(content["card"])
            return cls(
                card,
                KINDS[card.method].from_arrays(_below("predictor", arrays)),
                Novelty.from_arrays(_below("novelty", arrays)),
                arrays["typical"],
            )
        except FormatError:
            raise
        except OSError as error:
            raise FormatError(path, f"cannot be read ({error.strerror or error})") from error
        except Exception as error:  # those of zipfile, zlib, tokenize and NumPy have no common base
            raise FormatError(
                path, f"is not a whole model file ({error}); train it again"
            ) from error


def _prefixed(prefix: str, arrays: Mapping[str, ndarray]) -> dict[str, Any]:
    return {f"{prefix}/{name}": array for name, array in arrays.items()}


def _below(prefix: str, arrays: Mapping[str, ndarray]) -> dict[str, ndarray]:
    return {
        name.removeprefix(f"{prefix}/"): array
        for name, array in arrays.items()
        if name.startswith(f"{prefix}/")
    }
