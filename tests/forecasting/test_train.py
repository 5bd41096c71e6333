"""Training: methods, what they use, and what they refuse."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import synthetic
from graspcast.bop.models import Models
from graspcast.errors import InputError, UnknownNameError
from graspcast.evaluation.scores import score
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
from graspcast.forecasting.models.mlp.types import MlpSettings
from graspcast.forecasting.train import train_forecaster
from graspcast.paper.dataset import Published
from poses import write_models

SHORT = NetworkSettings(members=2, optimiser=MlpSettings(epochs=80, rate=1e-2))


def test_training_does_not_depend_on_the_order_of_estimators_but_on_the_principal() -> None:
    samples = synthetic.tried()
    one = train_forecaster(samples, method="MLP-O", settings=SHORT)
    other = synthetic.own_outcomes(samples.estimates, samples.own_success, "b")
    two = train_forecaster(other, method="MLP-O", settings=SHORT)
    assert two.card.supporters == ("a", "c")
    unseen = synthetic.estimates(20, seed=5)
    assert (one.probability(unseen) != two.probability(unseen)).any()
    assert_array_equal(
        train_forecaster(samples, method="MLP-O", settings=SHORT).probability(unseen),
        one.probability(unseen),
    )


@pytest.mark.parametrize("method", ["direct", "MLP-O"])
def test_the_order_in_which_estimators_are_given_changes_no_byte_of_the_model(
    tmp_path: Path, method: str
) -> None:
    samples = synthetic.tried()
    files = []
    for order in (("a", "b", "c"), ("c", "a", "b"), ("b", "c", "a")):
        forecaster = train_forecaster(
            samples.only(*order),
            method=method,
            settings=SHORT,
            forests=ForestSettings(trees=3, folds=0),
            models={"d": Models(write_models(tmp_path / "models", obj_1={}, obj_2={}))},
        )
        forecaster.save(tmp_path / "m.npz")
        files.append((tmp_path / "m.npz").read_bytes())
    assert files[0] == files[1] == files[2]


def test_what_cannot_be_trained_on_is_refused() -> None:
    samples = synthetic.tried(40)
    with pytest.raises(UnknownNameError, match=r"unknown method 'MLP-G'.*direct, threshold, MLP"):
        train_forecaster(samples, method="MLP-G")
    with pytest.raises(InputError, match=r"9 outcomes of a with . successes are too few"):
        train_forecaster(samples.select(np.arange(9)))
    for value in (True, False):
        alike = synthetic.own_outcomes(samples.estimates, np.full(40, value))
        with pytest.raises(InputError, match="with both successes and failures"):
            train_forecaster(alike)
    with pytest.raises(InputError, match="validated or last, not 'paper'"):
        train_forecaster(
            samples, method="MLP-O", settings=dataclasses.replace(SHORT, protocol="paper")
        )


@pytest.mark.slow
@pytest.mark.parametrize("way", [("threshold", "paper"), ("MLP-O", "rich")], ids="-".join)
def test_it_beats_the_majority_on_the_published_test_part(
    data: Published, way: tuple[str, str]
) -> None:
    method, features = way
    gain = []
    for gripper in ("parallel", "underactuated"):
        samples, part = data.tried("gdrnpp", gripper)
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
            forecaster.probability(test.estimates, data.models), test.own_success == 1, test.objects
        )
        assert found.accuracy > found.majority
        assert found.auroc > 0.8
        assert found.brier < test.own_success.var()
        gain.append(found.accuracy - found.majority)
    assert max(gain) > 0.05  # over two standard errors
