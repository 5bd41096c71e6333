"""Cross-validated probabilities: no forecaster is trained on the scene that it forecasts."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest
from numpy.testing import assert_array_equal

from graspcast import Estimates, Models, TrainingData, score
from graspcast.evaluation.cross_validation import cross_validate, cross_validated
from graspcast.forecasting import train
from poses import write_models
from supporters import EstimatorWorld
from synthetic import with_keys


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Models]:
    folder = write_models(tmp_path_factory.mktemp("models"), obj_1={}, obj_2={})
    return {"made": Models(folder)}


def test_blocks_of_frames_are_cut_as_in_training(
    monkeypatch: pytest.MonkeyPatch, models: dict[str, Models]
) -> None:
    """Of one scene's 100 frames 60 were tried: none is judged by its own block of 20 frames."""
    world = EstimatorWorld.make(100, scenes=1)
    tried = dataclasses.replace(world, outcomes=world.outcomes.filter(pl.col("im_id") < 60))
    judged: list[int] = []

    def spy(kept: TrainingData, **options: Any) -> Any:
        forecaster = training_of(kept, **options)
        seen = set((kept.estimates.im_id // 20).tolist())

        def probability(estimates: Estimates, *more: Any, **named: Any) -> np.ndarray:
            assert not seen & set((estimates.im_id // 20).tolist())
            judged.extend(estimates.im_id.tolist())
            return forecaster.probability(estimates, *more, **named)

        return SimpleNamespace(card=forecaster.card, probability=probability)

    training_of = train.train_forecaster
    monkeypatch.setattr("graspcast.evaluation.cross_validation.train_forecaster", spy)
    given = tried.training_data("a")
    probability = cross_validated(given, folds=3, method="threshold", models=models)
    assert sorted(judged) == list(range(60))
    assert not np.isnan(probability).any()
    found = cross_validate(given, folds=3, method="threshold", models=models)
    assert found == score(probability, given.samples.success, given.samples.objects)


def test_an_object_of_one_scene_has_no_probability(models: dict[str, Models]) -> None:
    world = EstimatorWorld.make(120, scenes=6)
    given = world.training_data("a")
    alone = with_keys(given.estimates, obj_id=np.where(given.estimates.scene_id == 2, 2, 1))
    given = dataclasses.replace(given, estimates=alone)
    probability = cross_validated(given, folds=3, method="threshold", models=models)
    assert_array_equal(np.isnan(probability), alone.scene_id == 2)
