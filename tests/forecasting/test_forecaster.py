"""Forecasters: files, forecasts, verdicts, and invalid input."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import synthetic
from graspcast.bop.models import Models
from graspcast.errors import InputError, MismatchError
from graspcast.evaluation.scores import score
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
from graspcast.forecasting.models.mlp.types import MlpSettings
from graspcast.forecasting.train import train_forecaster
from graspcast.forecasting.training_data import TrainingData
from poses import random_poses, write_models

SHORT = NetworkSettings(members=2, optimiser=MlpSettings(epochs=80, rate=1e-2))
WAYS = [("threshold", "paper"), ("MLP", "paper"), ("MLP-O", "paper"), ("MLP-O", "rich")]


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Models]:
    folder = write_models(tmp_path_factory.mktemp("models"), obj_1={}, obj_2={})
    return {"d": Models(folder)}


@pytest.fixture(scope="module")
def trained(models: dict[str, Models]) -> dict[tuple[str, str], Forecaster]:
    samples = synthetic.tried(360)
    return {
        (method, features): train_forecaster(
            samples, method=method, features=features, settings=SHORT, models=models
        )
        for method, features in WAYS
    }


def poses_of(samples: TrainingData, i: int) -> dict[str, np.ndarray]:
    given_ = samples.estimates
    return dict(zip(given_.estimators, given_.cam_T_obj[:, i], strict=True))


@pytest.mark.parametrize("way", WAYS, ids="-".join)
def test_it_comes_back_from_its_file(
    trained: dict[tuple[str, str], Forecaster],
    models: dict[str, Models],
    tmp_path: Path,
    way: tuple[str, str],
) -> None:
    forecaster = trained[way]
    forecaster.save(tmp_path / "model.npz")
    again = Forecaster.load(tmp_path / "model.npz")
    unseen = synthetic.tried(40, seed=9).estimates
    expected = forecaster.probability(unseen, models)
    assert_array_equal(again.probability(unseen, models), expected)
    assert json.loads(json.dumps(dataclasses.asdict(again.card))) == json.loads(
        json.dumps(dataclasses.asdict(forecaster.card))
    )
    assert (again.card.supporters, again.card.objects) == (("b", "c"), ("d-1", "d-2"))
    # Nothing in the file needs pickle.
    with np.load(tmp_path / "model.npz", allow_pickle=False) as file:
        assert all(file[name].dtype != object for name in file.files)


@pytest.mark.parametrize("way", WAYS, ids="-".join)
def test_it_learns_and_one_instance_is_judged_as_in_a_batch(
    trained: dict[tuple[str, str], Forecaster], models: dict[str, Models], way: tuple[str, str]
) -> None:
    forecaster, unseen = trained[way], synthetic.tried(80, seed=9)
    probability = forecaster.probability(unseen.estimates, models)
    found = score(probability, unseen.own_success == 1, unseen.objects)
    assert found.accuracy > found.majority + 0.2
    for i in (0, 1, 17):
        name = str(unseen.objects[i])
        verdict = forecaster.predict(poses_of(unseen, i), name, models=models, threshold=0.7)
        assert verdict.probability == pytest.approx(probability[i], rel=1e-6)
        assert verdict.attempt == (probability[i] >= 0.7)


@pytest.mark.parametrize("way", WAYS, ids="-".join)
def test_the_order_of_estimators_and_others_beside_them_change_nothing(
    trained: dict[tuple[str, str], Forecaster], models: dict[str, Models], way: tuple[str, str]
) -> None:
    forecaster = trained[way]
    given_ = synthetic.estimates(30, seed=9, names=("a", "b", "c", "x"))
    expected = forecaster.probability(given_.only("a", "b", "c"), models)
    for order in (("c", "a", "b"), ("b", "c", "a", "x"), ("x", "a", "c", "b")):
        assert_array_equal(forecaster.probability(given_.only(*order), models), expected)


# --- The card -------------------------------------------------------------------------------------


# --- What is refused ------------------------------------------------------------------------------


def test_other_estimators_and_objects_are_refused(
    trained: dict[tuple[str, str], Forecaster], models: dict[str, Models]
) -> None:
    forecaster = trained["MLP-O", "paper"]
    given_ = synthetic.estimates(6, names=("a", "x", "c"))
    says = r"needs estimates by a \(principal\) and b, c, but there are none by b; given: a, x, c"
    with pytest.raises(MismatchError, match=says):
        forecaster.probability(given_)
    three = dict(zip("abc", given_.cam_T_obj[:, 0], strict=True))
    with pytest.raises(MismatchError, match="none by a, b, c; given: none"):
        forecaster.predict({}, "d-1")
    with pytest.raises(MismatchError, match=r"was not trained for d-7; it knows d-1, d-2"):
        forecaster.probability(synthetic.estimates(6, objects=(1, 7)))
    for name in ("d-7", "e-1", "ape", "", "d-", "d-²", "d-" + 30 * "9"):
        with pytest.raises(MismatchError, match="it knows d-1, d-2"):
            forecaster.predict(three, name)
    for way in (("threshold", "paper"), ("MLP-O", "rich")):
        assert trained[way].needs_models
        with pytest.raises(
            MismatchError, match="models for dataset 'd'; there are models of: none"
        ):
            trained[way].predict(three, "d-1", models={})
        carried = trained[way].predict(three, "d-1")
        assert carried.reason == trained[way].predict(three, "d-1", models=models).reason
        with pytest.raises(MismatchError, match="there are models of: lmo, ycbv"):
            elsewhere = {"lmo": models["d"], "ycbv": models["d"]}
            trained[way].predict(three, "d-1", models=elsewhere)
    assert not forecaster.needs_models


@pytest.mark.ill_typed
def test_what_is_no_pose_or_no_probability_is_refused(
    trained: dict[tuple[str, str], Forecaster],
) -> None:
    forecaster = trained["MLP-O", "paper"]
    pose = random_poses(1)[0]
    for bad in (np.eye(3), np.zeros((1, 4, 4)), "pose"):
        with pytest.raises(InputError, match="the pose by b is not a 4x4 matrix of numbers"):
            forecaster.predict({"a": pose, "b": bad, "c": pose.copy()}, "d-1")
    for threshold in (-0.1, 1.1, float("nan")):
        with pytest.raises(InputError, match="a probability between 0 and 1"):
            forecaster.predict({name: pose.copy() for name in "abc"}, "d-1", threshold=threshold)


# --- Cross-validation -----------------------------------------------------------------------------


# --- Real data ------------------------------------------------------------------------------------
