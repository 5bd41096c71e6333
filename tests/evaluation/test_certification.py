"""Certifying a forecaster: its calibration data, its threshold sequence, its provenance."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from graspcast.errors import MismatchError
from graspcast.estimates.instances import unit_names
from graspcast.evaluation.certification import certify_forecaster
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
from graspcast.forecasting.models.mlp.types import MlpSettings
from graspcast.forecasting.models.out_of_fold import OutOfFold
from graspcast.forecasting.train import train_forecaster
from graspcast.forecasting.training_data import TrainingData
from graspcast.guarantees.certify import certify
from graspcast.guarantees.threshold_sequence import learn_sequence
from synthetic import tried, with_keys

SHORT = NetworkSettings(members=1, optimiser=MlpSettings(epochs=200, rate=1e-2))


@pytest.fixture(scope="module")
def forecaster() -> Forecaster:
    return train_forecaster(tried(120, noise=0.0), method="MLP-O", settings=SHORT)


@pytest.fixture(scope="module")
def calibration() -> TrainingData:
    """240 trials in 80 scenes from number 100 on."""
    given = tried(240, seed=3, noise=0.0, scenes=80)
    estimates = with_keys(given.estimates, scene_id=given.estimates.scene_id + 100)
    return dataclasses.replace(given, estimates=estimates)


def test_it_certifies_the_forecasts_for_the_units(
    forecaster: Forecaster, calibration: TrainingData
) -> None:
    found = certify_forecaster(
        forecaster, calibration, rate=0.8, unit="image", ood_alpha=0.0, per_object=True, seed=4
    )
    expected = certify(
        forecaster.probability(calibration.estimates),
        calibration.own_success == 1,
        unit_names(calibration.estimates.instances, "image"),
        objects=calibration.objects,
        rate=0.8,
        confidence=0.9,
        seed=4,
    )
    assert found.guarantees == expected.guarantees
    assert found.overall.threshold is not None
    stated = {k: v for k, v in found.provenance.items() if k != "versions"}
    assert stated == {
        "model": forecaster.card.digest,
        "ood_alpha": 0.0,
        "principal": "a",
        "gripper": "parallel",
        "grasp": "reference",
        "datasets": ["d"],
        "unit": "image",
        "training_scenes": 0,
    }
    found.check_belongs_to(forecaster.card.digest, 0.0)


def test_what_is_out_of_distribution_is_not_attempted(
    forecaster: Forecaster, calibration: TrainingData
) -> None:
    none = certify_forecaster(forecaster, calibration, rate=0.8, ood_alpha=1.0)
    assert (none.overall.attempts, none.overall.threshold) == (0, None)


def test_what_is_abstained_from_is_no_attempt_at_threshold_0(
    forecaster: Forecaster, calibration: TrainingData
) -> None:
    """A sequence learned from few units ends at their least probability, here 0."""
    options = {"rate": 0.3, "confidence": 0.8, "sequence_share": 0.3, "unit": "image"}
    found = certify_forecaster(forecaster, calibration, ood_alpha=0.5, **options)  # type: ignore[arg-type]
    assert found.sequence.thresholds[-1] == 0.0
    assert found.overall.threshold == 0.0
    certain = [v.may_attempt for v in forecaster.verdicts(calibration.estimates, ood_alpha=0.5)]
    assert 0 < found.overall.attempts <= sum(certain) < len(certain)


@pytest.mark.ill_typed
def test_the_sequence_is_learned_from_out_of_fold_predictions(
    forecaster: Forecaster, calibration: TrainingData
) -> None:
    rng = np.random.default_rng(0)
    probability = rng.random(300)
    past = OutOfFold(
        probability,
        rng.random(300) < probability,
        np.array([f"d/{i // 6}/{i}" for i in range(300)]),
    )
    predictor = _WithPredictions(forecaster.predictor.probability, past)
    forecaster = dataclasses.replace(forecaster, predictor=predictor)  # type: ignore[arg-type]
    target = {"rate": 0.8, "confidence": 0.9}
    found = certify_forecaster(forecaster, calibration, **target)
    assert found.sequence == learn_sequence(
        past.probability, past.success, past.units("scene"), calibration_units=80, **target
    )
    shared = certify_forecaster(forecaster, calibration, sequence_share=0.25, **target)
    assert shared.sequence.source == "20 of 80 units, not used for certification"
    assert shared.overall.units == 60


@dataclasses.dataclass(frozen=True)
class _WithPredictions:
    """A predictor with out-of-fold predictions."""

    probability: object
    out_of_fold: OutOfFold


def test_training_scenes_are_refused_unless_they_are_allowed(
    forecaster: Forecaster, calibration: TrainingData
) -> None:
    columns = {"scene_id": calibration.estimates.scene_id - 98}
    known = dataclasses.replace(calibration, estimates=with_keys(calibration.estimates, **columns))
    with pytest.raises(MismatchError, match=r"4 of the 80 calibration scenes \(d/2, d/3, d/4") as e:
        certify_forecaster(forecaster, known)
    assert e.value.parameters == ("outcomes", "allow_training_scenes")
    allowed = certify_forecaster(forecaster, known, allow_training_scenes=True)
    assert allowed.provenance["training_scenes"] == 4
    unstated = dataclasses.replace(forecaster, card=dataclasses.replace(forecaster.card, scenes=()))
    assert certify_forecaster(unstated, known).provenance["training_scenes"] is None
