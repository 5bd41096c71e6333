"""Forecasters: trained, saved, read back, asked; and what they refuse."""

from __future__ import annotations

import dataclasses
import json
import platform
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import synthetic
from graspcast._version import __version__
from graspcast.bop.models import Models
from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.instances import scene_groups
from graspcast.evaluation.cross_validation import cross_validate
from graspcast.evaluation.scores import score
from graspcast.forecasting.forecaster import KINDS, Forecaster
from graspcast.forecasting.model_card import ModelCard
from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
from graspcast.forecasting.models.mlp.types import MlpSettings
from graspcast.forecasting.samples import Samples
from graspcast.forecasting.train import train_forecaster
from graspcast.forecasting.training_data import TrainingData
from graspcast.paper.dataset import Published
from poses import write_models

SHORT = NetworkSettings(members=2, optimiser=MlpSettings(epochs=80, rate=1e-2))
WAYS = [("threshold", "paper"), ("MLP", "paper"), ("MLP-O", "paper"), ("MLP-O", "rich")]


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Models]:
    folder = write_models(tmp_path_factory.mktemp("models"), obj_1={}, obj_2={})
    return {"d": Models(folder)}


@pytest.fixture(scope="module")
def trained(models: dict[str, Models]) -> dict[tuple[str, str], Forecaster]:
    samples = synthetic.samples(360)
    return {
        (method, features): train_forecaster(
            samples, method=method, features=features, settings=SHORT, models=models
        )
        for method, features in WAYS
    }


def poses_of(samples: Samples, i: int) -> dict[str, np.ndarray]:
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
    unseen = synthetic.samples(40, seed=9).estimates
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
    forecaster, unseen = trained[way], synthetic.samples(80, seed=9)
    probability = forecaster.probability(unseen.estimates, models)
    found = score(probability, unseen.success, unseen.objects)
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


def test_training_does_not_depend_on_the_order_of_estimators_but_on_the_principal() -> None:
    samples = synthetic.samples()
    one = train_forecaster(samples, method="MLP-O", settings=SHORT)
    other = dataclasses.replace(samples, principal="b")
    two = train_forecaster(other, method="MLP-O", settings=SHORT)
    assert two.card.supporters == ("a", "c")
    unseen = synthetic.estimates(20, seed=5)
    assert (one.probability(unseen) != two.probability(unseen)).any()
    assert_array_equal(
        train_forecaster(samples, method="MLP-O", settings=SHORT).probability(unseen),
        one.probability(unseen),
    )


# --- The card -------------------------------------------------------------------------------------


def card(samples: Samples, **options: Any) -> ModelCard:
    options = {"method": "MLP-O", "settings": dataclasses.replace(SHORT, members=1)} | options
    return train_forecaster(samples, **options).card


def test_the_card_says_what_it_was_made_of(models: dict[str, Models]) -> None:
    samples = synthetic.samples(60)
    made = card(samples, method="MLP-O", features="rich", models=models)
    assert (made.principal, made.gripper, made.method) == ("a", "parallel", "MLP-O")
    assert made.features == "rich"
    assert made.settings["standardise"] is True
    assert made.settings["optimiser"]["epochs"] == 80
    assert made.samples == 60
    assert made.success_rate == samples.success.mean()
    assert made.versions == {
        "graspcast": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
    threshold = card(samples, method="threshold", models=models)
    assert (threshold.features, threshold.settings) == ("add", {})


def test_the_hash_is_that_of_the_data() -> None:
    samples = synthetic.samples(40)
    hashed = card(samples).data
    assert len(hashed) == 64
    assert card(samples, method="MLP").data == hashed
    poses = samples.estimates.cam_T_obj.copy()
    poses[2, 7, 0, 3] = np.nextafter(poses[2, 7, 0, 3], 1)
    attribution = dataclasses.replace(samples.estimates, cam_T_obj=poses)
    flipped = samples.success.copy()
    flipped[3] ^= True
    renamed = synthetic.with_keys(samples.estimates, im_id=samples.estimates.im_id + 1)
    others = [
        dataclasses.replace(samples, estimates=attribution),
        dataclasses.replace(samples, success=flipped),
        dataclasses.replace(samples, estimates=renamed),
    ]
    assert len({hashed, *(card(other).data for other in others)}) == 4


# --- What is refused ------------------------------------------------------------------------------


def test_other_estimators_and_objects_are_refused(
    trained: dict[tuple[str, str], Forecaster], models: dict[str, Models]
) -> None:
    forecaster = trained["MLP-O", "paper"]
    given_ = synthetic.estimates(6, names=("a", "x", "c"))
    says = r"needs estimates by a \(principal\) and b, c, but there are none by b; given: a, x, c"
    with pytest.raises(MismatchError, match=says):
        forecaster.probability(given_)
    pose = given_.cam_T_obj[0, 0]
    with pytest.raises(MismatchError, match="none by a, b, c; given: none"):
        forecaster.predict({}, "d-1")
    with pytest.raises(MismatchError, match=r"was not trained for d-7; it knows d-1, d-2; .*--obj"):
        forecaster.probability(synthetic.estimates(6, objects=(1, 7)))
    for name in ("d-7", "e-1", "ape", "", "d-", "d-²", "d-" + 30 * "9"):
        with pytest.raises(MismatchError, match="it knows d-1, d-2"):
            forecaster.predict(dict.fromkeys("abc", pose), name)
    for way in (("threshold", "paper"), ("MLP-O", "rich")):
        assert trained[way].needs_models
        with pytest.raises(MismatchError, match="no object models for dataset 'd'; known: none"):
            trained[way].predict(dict.fromkeys("abc", pose), "d-1")
        with pytest.raises(MismatchError, match="known: lmo, ycbv"):
            elsewhere = {"lmo": models["d"], "ycbv": models["d"]}
            trained[way].predict(dict.fromkeys("abc", pose), "d-1", models=elsewhere)
    assert not forecaster.needs_models


@pytest.mark.ill_typed
def test_what_is_no_pose_or_no_probability_is_refused(
    trained: dict[tuple[str, str], Forecaster],
) -> None:
    forecaster = trained["MLP-O", "paper"]
    pose = np.eye(4)
    for bad in (np.eye(3), np.full((4, 4), np.nan), np.zeros((1, 4, 4))):
        with pytest.raises(InputError, match="the pose by b is not a 4x4 matrix of finite numbers"):
            forecaster.predict({"a": pose, "b": bad, "c": pose}, "d-1")
    for threshold in (-0.1, 1.1, float("nan")):
        with pytest.raises(InputError, match="a probability between 0 and 1"):
            forecaster.predict(dict.fromkeys("abc", pose), "d-1", threshold=threshold)


def test_what_cannot_be_trained_on_is_refused() -> None:
    samples = synthetic.samples(40)
    with pytest.raises(UnknownNameError, match=f"unknown method 'MLP-G'.*{', '.join(KINDS)}"):
        train_forecaster(samples, method="MLP-G")
    with pytest.raises(InputError, match=r"9 samples with . successes are too few"):
        train_forecaster(samples.select(np.arange(9)))
    for value in (True, False):
        alike = dataclasses.replace(samples, success=np.full(40, value))
        with pytest.raises(InputError, match="with both outcomes"):
            train_forecaster(alike)
    with pytest.raises(InputError, match="validated or last, not 'paper'"):
        train_forecaster(
            samples, method="MLP-O", settings=dataclasses.replace(SHORT, protocol="paper")
        )


# --- Cross-validation -----------------------------------------------------------------------------


def test_only_unseen_scenes_are_scored(monkeypatch: pytest.MonkeyPatch) -> None:
    samples = synthetic.samples(120, scenes=6)
    groups = dict(
        zip(
            samples.estimates.im_id.tolist(), scene_groups(samples.estimates.instances), strict=True
        )
    )
    asked: list[int] = []

    def spy(given_data: TrainingData, **options: Any) -> Forecaster:
        forecaster = train_forecaster(given_data, **options)
        seen = {groups[i] for i in given_data.estimates.im_id.tolist()}

        class Watching(Forecaster):
            def probability(
                self, estimates: Any, models: Any = None, *, unseen_objects: bool = False
            ) -> np.ndarray:
                assert not unseen_objects
                assert not {groups[i] for i in estimates.im_id.tolist()} & seen
                asked.extend(estimates.im_id.tolist())
                return super().probability(estimates, models)

        fields = dataclasses.fields(forecaster)
        return Watching(*(getattr(forecaster, field.name) for field in fields))

    monkeypatch.setattr("graspcast.evaluation.cross_validation.train_forecaster", spy)
    heard: list[float] = []
    found = cross_validate(samples, folds=3, method="MLP-O", settings=SHORT, progress=heard.append)
    assert sorted(asked) == samples.estimates.im_id.tolist()
    assert found.n == 120
    assert found.accuracy > found.majority
    assert heard == sorted(heard)
    assert heard[-1] == 1.0


def test_an_object_of_one_scene_is_not_scored(models: dict[str, Models]) -> None:
    samples = synthetic.samples(120, scenes=6)
    estimates = samples.estimates
    alone = estimates.scene_id == 5
    obj_id = np.where(alone, 2, 1)
    samples = dataclasses.replace(samples, estimates=synthetic.with_keys(estimates, obj_id=obj_id))
    # One scene a fold: that of object 2 is left with nothing to ask.
    found = cross_validate(samples, folds=6, method="threshold", models=models)
    assert found.n == 100


# --- Real data ------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("way", [("threshold", "paper"), ("MLP-O", "rich")], ids="-".join)
def test_it_beats_the_majority_on_the_published_test_part(
    data: Published, way: tuple[str, str]
) -> None:
    method, features = way
    gain = []
    for gripper in ("parallel", "underactuated"):
        samples, part = data.samples("gdrnpp", gripper)
        quick = NetworkSettings(members=3, optimiser=MlpSettings(epochs=300))
        forecaster = train_forecaster(
            samples.select(part == "train"),
            method=method,
            features=features,  # type: ignore[arg-type]
            settings=quick,
            models=data.models,
        )
        test = samples.select(part == "test")
        found = score(
            forecaster.probability(test.estimates, data.models), test.success, test.objects
        )
        assert found.accuracy > found.majority
        assert found.auroc > 0.8
        assert found.brier < test.success.var()
        gain.append(found.accuracy - found.majority)
    assert max(gain) > 0.05  # over two standard errors


@pytest.mark.parametrize("method", ["threshold", "MLP-O"])
def test_each_object_is_scored_by_a_forecaster_that_has_not_seen_it(
    method: str, models: dict[str, Models], monkeypatch: pytest.MonkeyPatch
) -> None:
    given = synthetic.samples(160)
    seen: list[tuple[str, ...]] = []

    def spy(part: TrainingData, **options: Any) -> Forecaster:
        forecaster = train_forecaster(part, **options)
        seen.append(forecaster.card.objects)
        return forecaster

    monkeypatch.setattr("graspcast.evaluation.cross_validation.train_forecaster", spy)
    options: dict[str, Any] = {"method": method, "models": models, "settings": SHORT}
    found = cross_validate(given, by="object", **options)
    assert seen == [("d-2",), ("d-1",)]
    assert found.n == 160
    assert found.accuracy > 0.7  # what disagreement means carries over from one object to the other


def test_what_knows_an_object_only_by_its_own_networks_cannot_answer_for_another() -> None:
    with pytest.raises(MismatchError, match="cannot answer for an unseen one"):
        cross_validate(synthetic.samples(80), by="object", method="MLP", settings=SHORT)
    forecaster = train_forecaster(synthetic.samples(80), method="MLP-O", settings=SHORT)
    other = synthetic.samples(10, objects=(7,)).estimates
    with pytest.raises(MismatchError, match="was not trained for d-7"):
        forecaster.probability(other)
    assert forecaster.probability(other, unseen_objects=True).shape == (10,)
