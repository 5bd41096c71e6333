"""The model card: contents and digest."""

from __future__ import annotations

import dataclasses
import platform
from typing import Any

import numpy as np
import pytest

import synthetic
from graspcast._version import __version__
from graspcast.bop.models import Models
from graspcast.forecasting.model_card import ModelCard
from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
from graspcast.forecasting.models.mlp.types import MlpSettings
from graspcast.forecasting.train import train_forecaster
from graspcast.forecasting.training_data import TrainingData
from poses import write_models

SHORT = NetworkSettings(members=2, optimiser=MlpSettings(epochs=80, rate=1e-2))


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Models]:
    folder = write_models(tmp_path_factory.mktemp("models"), obj_1={}, obj_2={})
    return {"d": Models(folder)}


def card(samples: TrainingData, **options: Any) -> ModelCard:
    options = {"method": "MLP-O", "settings": dataclasses.replace(SHORT, members=1)} | options
    return train_forecaster(samples, **options).card


def test_the_card_says_what_it_was_made_of(models: dict[str, Models]) -> None:
    samples = synthetic.tried(60)
    made = card(samples, method="MLP-O", features="rich", models=models)
    assert (made.principal, made.gripper, made.method) == ("a", "parallel", "MLP-O")
    assert made.features == "rich"
    assert made.settings["standardise"] is True
    assert made.settings["optimiser"]["epochs"] == 80
    assert made.samples == 60
    assert made.success_rate == samples.own_success.mean()
    assert made.versions == {
        "graspcast": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
    assert made.smallest_p_value == 1 / 61
    diameter = models["d"].info[1].diameter_m
    assert made.diameters_m == {"d-1": diameter, "d-2": diameter}
    assert [text[:25] for text in made.warnings] == ["60 instances give a small"]
    threshold = card(samples, method="threshold", models=models)
    assert (threshold.features, threshold.settings) == ("add", {})


def test_the_hash_is_that_of_the_data() -> None:
    samples = synthetic.tried(40)
    hashed = card(samples).data
    assert len(hashed) == 64
    assert card(samples, method="MLP").data == hashed
    poses = samples.estimates.cam_T_obj.copy()
    poses[2, 7, 0, 3] = np.nextafter(poses[2, 7, 0, 3], 1)
    attribution = dataclasses.replace(samples.estimates, cam_T_obj=poses)
    flipped = samples.own_success.copy()
    flipped[3] = 1 - flipped[3]
    renamed = synthetic.with_keys(samples.estimates, im_id=samples.estimates.im_id + 1)
    others = [
        dataclasses.replace(samples, estimates=attribution),
        synthetic.own_outcomes(samples.estimates, flipped),
        dataclasses.replace(samples, estimates=renamed),
    ]
    assert len({hashed, *(card(other).data for other in others)}) == 4


def test_from_whom_was_also_learned_is_left_out_where_it_is_nobody() -> None:
    made = card(synthetic.tried(40))
    assert ModelCard.from_dict(made.as_dict()) == made
    assert "learned_from" not in made.as_dict()  # as cards of files of before
    more = dataclasses.replace(made, learned_from={"c": 30})
    assert ModelCard.from_dict(more.as_dict()) == more
    assert more.digest != made.digest
    for wrong in ({"c": -1}, {"c": 1.5}, ["c"]):
        with pytest.raises(ValueError, match="the card's learned_from is"):
            ModelCard.from_dict(more.as_dict() | {"learned_from": wrong})
