"""Attribution: groups of features, and the attributions of a linear model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy import ndarray
from numpy.testing import assert_allclose

import synthetic
from graspcast.bop.models import Models
from graspcast.forecasting.attribution import attributions, groups_of
from graspcast.forecasting.features import Features, FeatureSet, consensus_features
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.train import train_forecaster
from poses import write_models

ALONE = ("view_", "axis_")


@dataclass(frozen=True)
class Linear:
    """A linear model, whose attributions are known."""

    weights: ndarray

    def probability(self, features: ndarray, objects: ndarray) -> ndarray:
        return np.asarray(features @ self.weights + 0.01 * objects)

    def to_arrays(self) -> dict[str, ndarray]:
        return {"weights": self.weights}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ndarray]) -> Linear:
        return cls(arrays["weights"])


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Models]:
    folder = write_models(tmp_path_factory.mktemp("models"), obj_1={}, obj_2={})
    return {"d": Models(folder)}


@pytest.mark.parametrize("which", ["paper", "rich", "full"])
def test_groups_cover_all_that_supporters_say(
    which: Literal["paper", "rich", "full"], models: dict[str, Models]
) -> None:
    features = consensus_features(synthetic.estimates(4), "a", which=which, models=models)
    groups = groups_of(features.names)
    own = {"rotation by b", "position by b", "rotation by c", "position by c"}
    assert set(groups) == own | ({"b against c"} if which != "paper" else set())
    covered = {features.names[i] for columns in groups.values() for i in columns}
    left = {n for n in features.names if n.startswith(ALONE) or n == "distance"}
    assert covered == set(features.names) - left
    for group, columns in groups.items():
        assert len(set(columns.tolist())) == len(columns)
        for name in (features.names[i] for i in columns):
            others = name.split(".")[1:]
            if len(others) == 1:
                assert group.endswith(f"by {others[0]}"), (group, name)
                turns = name.startswith(("rot_", "angle", "turn_", "dpsi_"))
                assert group.startswith("rotation") == turns, (group, name)
            elif len(others) == 2:
                assert group == "b against c"
            else:
                assert group.startswith("rotation") == name.startswith("mid_turn"), (group, name)


def test_a_single_disagreement_is_a_group_of_its_own() -> None:
    groups = groups_of(("add_mean",))
    assert {name: columns.tolist() for name, columns in groups.items()} == {"disagreement": [0]}


@given(st.integers(0, 10**6))
def test_attributions_of_a_linear_model_are_the_sums_of_its_terms(seed: int) -> None:
    rng = np.random.default_rng(seed)
    names = ("rot_x.b", "dx.b", "ray.c", "angle_between.b.c", "view_x", "mid_turn_x", "add_max_rel")
    features = Features(names, rng.normal(size=(5, 7)))
    typical, weights = rng.normal(size=7), rng.normal(size=7)
    found = attributions(Linear(weights), features, rng.integers(0, 3, 5), typical)
    terms = (features.values - typical) * weights
    expected = {
        "rotation by b": terms[:, 0] + terms[:, 5],
        "position by b": terms[:, 1] + terms[:, 6],
        "position by c": terms[:, 2] + terms[:, 6],
        "b against c": terms[:, 3],
    }
    for i, row in enumerate(found):
        assert dict(row).keys() == expected.keys()
        for name, by in row:
            assert by == pytest.approx(expected[name][i], abs=1e-12)
        assert all(abs(a[1]) >= abs(b[1]) for a, b in pairwise(row))


def test_what_is_typical_moves_nothing() -> None:
    names = ("rot_x.b", "dx.b", "dx.c")
    typical = np.array([0.1, 0.2, 0.3])
    rows = np.array([[0.1, 0.2, 0.3], [0.1, 0.2, 7.0]])
    weights = np.array([1.0, -2.0, 0.5])
    same, other = attributions(Linear(weights), Features(names, rows), np.zeros(2, int), typical)
    assert {by for _, by in same} == {0.0}
    assert dict(other)["rotation by b"] == dict(other)["position by b"] == 0
    assert other[0] == ("position by c", pytest.approx(0.5 * 6.7))


@pytest.mark.parametrize(
    ("method", "which"), [("blend", "full"), ("threshold", "add"), ("MLP", "paper")]
)
def test_explanations_of_real_forecasters_are_differences_of_their_forecasts(
    method: str, which: FeatureSet, models: dict[str, Models]
) -> None:
    from graspcast.forecasting.features import features_of
    from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
    from graspcast.forecasting.models.mlp.types import MlpSettings

    forecaster = train_forecaster(
        synthetic.training_data(120),
        method=method,
        forests=ForestSettings(trees=8, folds=0),
        settings=NetworkSettings(members=1, optimiser=MlpSettings(epochs=50)),
        models=models,
    )
    unseen = synthetic.training_data(6, seed=3).estimates
    found = forecaster.explain(unseen, models)
    features = features_of(unseen, "a", which, models)
    probability = forecaster.probability(unseen, models)
    for group, columns in groups_of(features.names).items():
        changed = features.values.copy()
        changed[:, columns] = forecaster.typical[columns]
        without = forecaster.predictor.probability(changed, np.arange(6) % 2)
        attribution = [dict(row)[group] for row in found]
        assert_allclose(attribution, probability - without, atol=1e-12)
    assert max(abs(row[0][1]) for row in found) > 0.01
