"""Certification of a forecaster: a threshold with a guaranteed success rate, from new outcomes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import MismatchError
from graspcast.estimates.instances import Instances, UnitKind, unit_names
from graspcast.estimates.outcomes import REFERENCE_GRASP
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.model_card import ModelCard
from graspcast.forecasting.novelty import OOD_ALPHA
from graspcast.forecasting.training_data import TrainingData
from graspcast.guarantees.certificate import Certificate
from graspcast.guarantees.certify import certify
from graspcast.guarantees.promises import Alternative
from graspcast.guarantees.threshold_sequence import (
    ThresholdSequence,
    check_target,
    default_sequence,
    learn_sequence,
    split_sequence,
)
from graspcast.guarantees.unit_draws import Weight
from graspcast.io.arguments import a, checked, mapping, number
from graspcast.io.provenance import versions

__all__ = [
    "CalibrationTrials",
    "GuaranteeOptions",
    "certify_forecaster",
    "certify_trials",
    "check_scenes",
    "learned_sequence",
]


@dataclass(frozen=True)
class GuaranteeOptions:
    """What is to be guaranteed, as for :func:`certify_forecaster`."""

    rate: float = 0.9
    confidence: float = 0.9
    unit: UnitKind = "scene"
    weight: Weight = "attempt"
    ood_alpha: float = OOD_ALPHA
    per_object: bool = False
    simultaneous: bool = False
    other_guarantees: int = 0
    sequence_share: float = 0.0
    accept_lower: bool = False
    seed: int = 0
    allow_training_scenes: bool = False

    def __post_init__(self) -> None:
        """Check the rate and the confidence, before anything is read for them."""
        check_target("rate", self.rate)
        check_target("confidence", self.confidence)


@dataclass(frozen=True, eq=False)
class CalibrationTrials:
    """Forecasts and outcomes of n instances after each look, one look or more.

    Attributes
    ----------
    instances
        Their keys.
    probability
        In the order of the looks; NaN where nothing is attempted at any threshold, (n, looks).
    success
        The outcome of what would be attempted there, (n, looks).
    """

    instances: Instances
    probability: Float[ndarray, "n s"]
    success: Bool[ndarray, "n s"]


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
    accept_lower: bool = False,
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
        principal and gripper. Those without an outcome of the grasp that the verdict chooses are
        left out.
    rate, confidence, weight, simultaneous, other_guarantees, accept_lower, seed
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
        Its provenance states the model's digest, ``ood_alpha``, principal, gripper, grasp (with
        several, the names of all), kind of unit, versions, and ``training_scenes``: how many of the
        calibration scenes the model was trained on, None if it does not state its training scenes.

    Raises
    ------
    MismatchError
        If the forecaster was trained on some of the scenes, or needs other estimators, or knows
        none of the objects.
    InputError
        As :func:`graspcast.certify`, or if ``sequence_share`` leaves no units on one side.
    """
    asked = GuaranteeOptions(
        rate=rate,
        confidence=confidence,
        unit=unit,
        weight=weight,
        ood_alpha=ood_alpha,
        per_object=per_object,
        simultaneous=simultaneous,
        other_guarantees=other_guarantees,
        sequence_share=sequence_share,
        accept_lower=accept_lower,
        seed=seed,
        allow_training_scenes=allow_training_scenes,
    )
    data = data.tried()
    instances = data.estimates.instances
    training_scenes = check_scenes(forecaster.card, instances, allow_training_scenes)
    # The verdicts decide what can be an attempt.
    verdicts = forecaster.verdicts(data.estimates, models, threshold=1.0, ood_alpha=ood_alpha)
    p = np.array([v.probability if v.may_attempt else np.nan for v in verdicts], dtype=float)
    success = data.outcome_of([verdict.grasp for verdict in verdicts])
    known = ~np.isnan(success) | np.isnan(p)  # what is never attempted needs no outcome
    if not known.any():
        raise MismatchError(
            "no instance has an outcome of the grasp that its verdict chooses: give outcomes of "
            "all grasps that the model knows",
            parameters=("outcomes",),
        )
    instances = instances.select(known)
    trials = CalibrationTrials(instances, p[known, None], (success == 1)[known, None])
    more = {"without_outcome": int((~known).sum())} if forecaster.card.grasps else {}
    learned = learned_sequence(forecaster, instances, asked)
    card = forecaster.card
    return certify_trials(card, trials, asked, training_scenes, sequence=learned, provenance=more)


def learned_sequence(
    forecaster: Forecaster, instances: Instances, asked: GuaranteeOptions
) -> ThresholdSequence | None:
    """Return the sequence by out-of-fold predictions; None without, or if a share teaches it.

    Parameters
    ----------
    forecaster
        With out-of-fold predictions of its training data, if it has any.
    instances
        Of the calibration data.
    asked
        What is to be guaranteed.
    """
    out_of_fold = getattr(forecaster.predictor, "out_of_fold", None)
    if asked.sequence_share or out_of_fold is None:
        return None
    return learn_sequence(
        out_of_fold.probability,
        out_of_fold.success,
        out_of_fold.units(asked.unit),
        calibration_units=len(np.unique(unit_names(instances, asked.unit))),
        rate=asked.rate,
        confidence=asked.confidence,
        weight=asked.weight,
    )


def certify_trials(
    card: ModelCard,
    trials: CalibrationTrials,
    asked: GuaranteeOptions,
    training_scenes: int | None,
    *,
    sequence: ThresholdSequence | None = None,
    provenance: Mapping[str, Any] | None = None,
) -> Certificate:
    """Certify the calibration trials of a forecaster.

    Parameters
    ----------
    card
        Of the forecaster.
    trials
        New ones.
    asked
        What is to be guaranteed.
    training_scenes
        How many of their scenes it was trained on; None if it does not state any.
    sequence
        Of the thresholds. If None, it is learned from ``asked.sequence_share`` of the units; if
        that is 0, it depends on no data.
    provenance
        Further entries of the certificate's.
    """
    target: dict[str, Any] = {
        "rate": asked.rate,
        "confidence": asked.confidence,
        "weight": asked.weight,
    }
    units = unit_names(trials.instances, asked.unit)
    kept = np.ones(len(units), dtype=bool)
    given = trials.probability, trials.success, units
    if sequence is None:
        share, seed = asked.sequence_share, asked.seed
        sequence, kept = split_sequence(*given, share=share, seed=seed, **target)
    objects = trials.instances.objects[kept] if asked.per_object else None
    mine = CalibrationTrials(
        trials.instances.select(kept), trials.probability[kept], trials.success[kept]
    )
    certificate = certify(
        mine.probability,
        mine.success,
        units[kept],
        objects=objects,
        sequence=sequence,
        simultaneous=asked.simultaneous,
        other_guarantees=asked.other_guarantees,
        accept_lower=asked.accept_lower,
        seed=asked.seed,
        provenance={
            "model": card.digest,
            "ood_alpha": asked.ood_alpha,
            "principal": card.principal,
            "gripper": card.gripper,
            "grasp": _grasps(card),
            "datasets": sorted({str(name) for name in trials.instances.dataset}),
            "unit": asked.unit,
            "training_scenes": training_scenes,
            "versions": versions(),
            **(provenance or {}),
        },
        **target,
    )
    # With the confidence of a single guarantee, as that for all objects has.
    one = replace(asked, confidence=certificate.overall.confidence)
    return replace(certificate, alternatives=_alternatives(mine, one, sequence))


def _alternatives(
    trials: CalibrationTrials, asked: GuaranteeOptions, sequence: ThresholdSequence
) -> tuple[Alternative, ...]:
    """Return what would have been promised, had something else been asked for beforehand.

    Images are no alternative to scenes: those of a video are not independent, which is not to be
    seen in the data.
    """
    usual: dict[str, Any] = {"weight": asked.weight, "sequence": sequence}
    names = {kind: unit_names(trials.instances, kind) for kind in (asked.unit, "scene")}
    looks = trials.probability.shape[1]
    changed: list[tuple[str, UnitKind, int, dict[str, Any]]] = []
    other: Weight = "unit" if asked.weight == "attempt" else "attempt"
    what = {
        "unit": f"all {asked.unit}s weighted equally",
        "attempt": "all attempts weighted equally",
    }
    changed.append((what[other], asked.unit, looks, {"weight": other}))
    if (fixed := default_sequence(asked.rate)) != sequence:
        changed.append(("thresholds that no data chose", asked.unit, looks, {"sequence": fixed}))
    if asked.unit != "scene":
        changed.append(("scenes as units", "scene", looks, {}))
    for fewer in range(1, looks):
        name = "one look" if fewer == 1 else f"at most {fewer} looks"
        changed.append((name, asked.unit, fewer, {}))
    out = []
    for name, unit, taken, more in changed:
        found = certify(
            trials.probability[:, :taken],
            trials.success[:, :taken],
            names[unit],
            rate=asked.rate,
            confidence=asked.confidence,
            seed=asked.seed,
            **{**usual, **more},
        ).overall
        confidence = found.possible_confidence or 0.0
        needed = found.needed_units
        out.append(
            Alternative(name, unit, found.units, found.threshold, found.best, confidence, needed)
        )
    return tuple(out)


def _grasps(card: ModelCard) -> str | list[str]:
    """Return the name of the one grasp that is certified, or those among which is chosen."""
    if not card.grasps:
        return REFERENCE_GRASP
    return sorted({name for some in card.grasps.values() for name in some})


def check_scenes(card: ModelCard, instances: Instances, allowed: bool) -> int | None:
    """Return how many of the scenes the model was trained on; None if it does not state any.

    Raises
    ------
    MismatchError
        If there are some, and that is not allowed.
    """
    if not card.scenes:
        return None
    scenes = set(unit_names(instances, "scene").tolist())
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
