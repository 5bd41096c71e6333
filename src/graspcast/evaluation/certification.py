"""Certification of a forecaster: a threshold with a guaranteed success rate, from new outcomes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import MismatchError
from graspcast.estimates.instances import UnitKind, unit_names
from graspcast.estimates.outcomes import REFERENCE_GRASP
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.model_card import ModelCard
from graspcast.forecasting.novelty import OOD_ALPHA
from graspcast.forecasting.training_data import TrainingData
from graspcast.guarantees.certificate import Certificate
from graspcast.guarantees.certify import certify
from graspcast.guarantees.threshold_sequence import (
    ThresholdSequence,
    learn_sequence,
    split_sequence,
)
from graspcast.guarantees.unit_draws import Weight
from graspcast.io.arguments import a, checked, mapping, number
from graspcast.io.provenance import versions

__all__ = ["certify_forecaster"]


@checked(
    forecaster=a(Forecaster),
    data=a(TrainingData),
    rate=number(),
    confidence=number(),
    models=mapping(a(Models), "dataset"),
    ood_alpha=number(0.0, 1.0),
)
def certify_forecaster(
    forecaster: Forecaster,
    data: TrainingData,
    *,
    rate: float = 0.9,
    confidence: float = 0.9,
    unit: UnitKind = "scene",
    weight: Weight = "attempt",
    models: Mapping[str, Models] | None = None,
    ood_alpha: float = OOD_ALPHA,
    per_object: bool = False,
    simultaneous: bool = False,
    other_guarantees: int = 0,
    sequence_share: float = 0.0,
    seed: int = 0,
    allow_training_scenes: bool = False,
) -> Certificate:
    """Find the threshold at which attempts by a forecaster are guaranteed to succeed at a rate.

    Parameters
    ----------
    forecaster
        Whose forecasts are certified.
    data
        Calibration data: instances of scenes that were not used in training, of the forecaster's
        principal and gripper. Those without an outcome are left out.
    rate, confidence, weight, simultaneous, other_guarantees, seed
        As for :func:`graspcast.certify`.
    unit
        The independent unit, ``scene`` or ``image``. Images of a video are not independent.
    models
        Dataset's name to its object models, if the forecaster needs them.
    ood_alpha
        Verdicts abstain where a disagreement is out of distribution at this level. What they
        abstain from at every threshold, as also where poses are not sane or objects unknown, is no
        attempt.
    per_object
        Certify each object too.
    sequence_share
        Learn the order of thresholds from this share of the units, which then take no part in
        certification. If 0, it is learned from the forecaster's out-of-fold predictions of its
        training data; if it has none, it depends on no data.
    allow_training_scenes
        Certify though the forecaster was trained on some of the scenes; the guarantee is then
        invalid.

    Returns
    -------
        Its provenance states the model's digest, ``ood_alpha``, principal, gripper, kind of unit,
        versions, and ``training_scenes``: how many of the calibration scenes the model was trained
        on, None if it does not state its training scenes.

    Raises
    ------
    MismatchError
        If the forecaster was trained on some of the scenes, or needs other estimators, or knows
        none of the objects.
    InputError
        As :func:`graspcast.certify`, or if ``sequence_share`` leaves no units on one side.
    """
    card = forecaster.card
    data = data.tried()
    success = data.own_success == 1
    training_scenes = _training_scenes(card, data, allow_training_scenes)
    # The verdicts decide what can be an attempt.
    verdicts = forecaster.verdicts(data.estimates, models, threshold=0.0, ood_alpha=ood_alpha)
    probability = np.array([(v.probability or 0.0) if v.attempt else 0.0 for v in verdicts])
    units = unit_names(data.estimates.instances, unit)
    target: dict[str, Any] = {"rate": rate, "confidence": confidence, "weight": weight}
    sequence, kept = _sequence(
        forecaster, probability, success, units, unit, sequence_share, seed, target
    )
    return certify(
        probability[kept],
        success[kept],
        units[kept],
        objects=data.objects[kept] if per_object else None,
        sequence=sequence,
        simultaneous=simultaneous,
        other_guarantees=other_guarantees,
        seed=seed,
        provenance={
            "model": card.digest,
            "ood_alpha": ood_alpha,
            "principal": card.principal,
            "gripper": card.gripper,
            "grasp": REFERENCE_GRASP,
            "datasets": sorted({str(name) for name in data.estimates.instances.dataset}),
            "unit": unit,
            "training_scenes": training_scenes,
            "versions": versions(),
        },
        **target,
    )


def _training_scenes(card: ModelCard, data: TrainingData, allowed: bool) -> int | None:
    """Return how many of the scenes the model was trained on; None if it does not state any."""
    if not card.scenes:
        return None
    scenes = set(unit_names(data.estimates.instances, "scene").tolist())
    seen = sorted(scenes.intersection(card.scenes))
    if seen and not allowed:
        some = ", ".join(seen[:5]) + (", ..." if len(seen) > 5 else "")
        raise MismatchError(
            f"the model was trained on {len(seen)} of the {len(scenes)} calibration scenes "
            f"({some}); give outcomes of other scenes, or allow them, which makes the guarantee "
            "invalid",
            parameters=("outcomes", "allow_training_scenes"),
        )
    return len(seen)


def _sequence(
    forecaster: Forecaster,
    probability: Float[ndarray, " n"],
    success: Bool[ndarray, " n"],
    units: ndarray,
    unit: UnitKind,
    share: float,
    seed: int,
    target: Mapping[str, Any],
) -> tuple[ThresholdSequence, Bool[ndarray, " n"]]:
    """Return the threshold sequence, and a mask of the trials to certify with."""
    out_of_fold = getattr(forecaster.predictor, "out_of_fold", None)
    if share or out_of_fold is None:
        return split_sequence(probability, success, units, share=share, seed=seed, **target)
    sequence = learn_sequence(
        out_of_fold.probability,
        out_of_fold.success,
        out_of_fold.units(unit),
        calibration_units=len(np.unique(units)),
        **target,
    )
    return sequence, np.ones(len(units), dtype=bool)
