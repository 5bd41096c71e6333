"""Cross-validation: what is in training, and what is scored."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest
from numpy.testing import assert_array_equal

import synthetic
from graspcast.bop.models import Models
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.instances import scene_groups
from graspcast.evaluation.cross_validation import cross_validate, cross_validated
from graspcast.evaluation.scores import score
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
from graspcast.forecasting.models.mlp.types import MlpSettings
from graspcast.forecasting.train import fit_forecaster
from graspcast.forecasting.training_data import TrainingData
from poses import write_models
from supporters import EstimatorWorld

SHORT = NetworkSettings(members=2, optimiser=MlpSettings(epochs=80, rate=1e-2))


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Models]:
    folder = write_models(tmp_path_factory.mktemp("models"), obj_1={}, obj_2={})
    return {"d": Models(folder)}


def test_only_unseen_scenes_are_scored(monkeypatch: pytest.MonkeyPatch) -> None:
    samples = synthetic.tried(120, scenes=6)
    groups = dict(
        zip(
            samples.estimates.im_id.tolist(), scene_groups(samples.estimates.instances), strict=True
        )
    )
    asked: list[int] = []

    def spy(given_data: TrainingData, **options: Any) -> Forecaster:
        forecaster = fit_forecaster(given_data, **options)
        seen = {groups[i] for i in given_data.estimates.im_id.tolist()}

        class Checked(Forecaster):
            def probability(
                self, estimates: Any, models: Any = None, *, unseen_objects: bool = False
            ) -> np.ndarray:
                assert not unseen_objects
                assert not {groups[i] for i in estimates.im_id.tolist()} & seen
                asked.extend(estimates.im_id.tolist())
                return super().probability(estimates, models)

        fields = dataclasses.fields(forecaster)
        return Checked(*(getattr(forecaster, field.name) for field in fields))

    monkeypatch.setattr("graspcast.evaluation.cross_validation.fit_forecaster", spy)
    heard: list[float] = []
    found = cross_validate(
        samples, folds=3, method="MLP-O", settings=SHORT, progress=lambda x, _: heard.append(x)
    )
    assert sorted(asked) == samples.estimates.im_id.tolist()
    assert found.n == 120
    assert found.accuracy > found.majority
    assert heard == sorted(heard)
    assert heard[-1] == 1.0


def test_an_object_of_one_scene_is_not_scored(models: dict[str, Models]) -> None:
    samples = synthetic.tried(120, scenes=6)
    estimates = samples.estimates
    alone = estimates.scene_id == 5
    obj_id = np.where(alone, 2, 1)
    samples = dataclasses.replace(samples, estimates=synthetic.with_keys(estimates, obj_id=obj_id))
    # One scene a fold: that of object 2 is left with nothing to ask.
    found = cross_validate(samples, folds=6, method="threshold", models=models)
    assert found.n == 100


def test_one_object_cannot_be_left_out() -> None:
    given = synthetic.tried(40)
    only = given.select(given.objects == "d-1")
    with pytest.raises(InputError, match=r"takes two or more with outcomes.* only d-1") as caught:
        cross_validate(only, by="object", method="threshold")
    assert "unseen_objects" in caught.value.parameters


@pytest.mark.parametrize("method", ["threshold", "MLP-O"])
def test_each_object_is_scored_by_a_forecaster_that_has_not_seen_it(
    method: str, models: dict[str, Models], monkeypatch: pytest.MonkeyPatch
) -> None:
    given = synthetic.tried(160)
    seen: list[tuple[str, ...]] = []

    def spy(part: TrainingData, **options: Any) -> Forecaster:
        forecaster = fit_forecaster(part, **options)
        seen.append(forecaster.card.objects)
        return forecaster

    monkeypatch.setattr("graspcast.evaluation.cross_validation.fit_forecaster", spy)
    options: dict[str, Any] = {"method": method, "models": models, "settings": SHORT}
    found = cross_validate(given, by="object", **options)
    assert seen == [("d-2",), ("d-1",)]
    assert found.n == 160
    assert found.accuracy > 0.7  # what disagreement means carries over from one object to the other


def test_what_knows_an_object_only_by_its_own_networks_cannot_answer_for_another() -> None:
    with pytest.raises(MismatchError, match="cannot forecast an unseen object"):
        cross_validate(synthetic.tried(80), by="object", method="MLP", settings=SHORT)
    forecaster = fit_forecaster(synthetic.tried(80), method="MLP-O", settings=SHORT)
    other = synthetic.tried(10, objects=(7,)).estimates
    with pytest.raises(MismatchError, match="was not trained for d-7"):
        forecaster.probability(other)
    assert forecaster.probability(other, unseen_objects=True).shape == (10,)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Models]:
    folder = write_models(tmp_path_factory.mktemp("made"), obj_1={}, obj_2={})
    return {"made": Models(folder)}


def test_blocks_of_frames_are_cut_as_in_training(
    monkeypatch: pytest.MonkeyPatch, made: dict[str, Models]
) -> None:
    """Of one scene's 100 frames 60 were tried: none is forecast from its own block of 20 frames."""
    world = EstimatorWorld.make(100, scenes=1)
    tried = dataclasses.replace(world, outcomes=world.outcomes.filter(pl.col("im_id") < 60))
    forecast_ids: list[int] = []

    def spy(kept: TrainingData, **options: Any) -> Any:
        forecaster = training_of(kept, **options)
        seen = set((kept.estimates.im_id // 20).tolist())

        def probability(estimates: Estimates, *more: Any, **named: Any) -> np.ndarray:
            assert not seen & set((estimates.im_id // 20).tolist())
            forecast_ids.extend(estimates.im_id.tolist())
            return forecaster.probability(estimates, *more, **named)

        return SimpleNamespace(card=forecaster.card, probability=probability)

    training_of = fit_forecaster
    monkeypatch.setattr("graspcast.evaluation.cross_validation.fit_forecaster", spy)
    given = tried.training_data("a")
    probability = cross_validated(given, folds=3, method="threshold", models=made)
    assert sorted(forecast_ids) == list(range(60))
    assert not np.isnan(probability).any()
    found = cross_validate(given, folds=3, method="threshold", models=made)
    assert found == score(probability, given.tried().own_success == 1, given.tried().objects)


def test_an_object_of_one_scene_has_no_probability(made: dict[str, Models]) -> None:
    world = EstimatorWorld.make(120, scenes=6)
    given = world.training_data("a")
    alone = synthetic.with_keys(
        given.estimates, obj_id=np.where(given.estimates.scene_id == 2, 2, 1)
    )
    given = dataclasses.replace(given, estimates=alone)
    probability = cross_validated(given, folds=3, method="threshold", models=made)
    assert_array_equal(np.isnan(probability), alone.scene_id == 2)
