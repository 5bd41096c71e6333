"""Ensembles of networks: training, arrays, and averages over members."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from graspcast.errors import InputError
from graspcast.forecasting.models.mlp.ensemble import NetworkEnsemble, NetworkSettings
from graspcast.forecasting.models.mlp.types import MlpSettings

SHORT = NetworkSettings(members=2, optimiser=MlpSettings(epochs=30, hidden=(8, 4), rate=1e-2))


def problem(seed: int = 0, n: int = 150, objects: int = 3) -> tuple[np.ndarray, ...]:
    """Features of very different sizes, outcomes, object numbers."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, 4))
    kind = np.arange(n) % objects
    return x * [1e-3, 1, 1, 50] + [0, 5, 0, 0], x[:, 0] + x[:, 3] > 0, kind


@pytest.mark.parametrize("protocol", ["validated", "last"])
@pytest.mark.parametrize("standardise", [True, False])
@pytest.mark.parametrize("pools_objects", [True, False])
def test_an_ensemble_comes_back_from_its_arrays(
    pools_objects: bool, standardise: bool, protocol: str
) -> None:
    features, success, kind = problem()
    settings = replace(
        SHORT, pools_objects=pools_objects, standardise=standardise, protocol=protocol
    )
    fitted = NetworkEnsemble.fit(features, success, kind, settings)
    assert [len(members) for members in fitted.members] == [2] * (1 if pools_objects else 3)
    again = NetworkEnsemble.from_arrays(fitted.to_arrays())
    probability = fitted.probability(features, kind)
    assert_array_equal(again.probability(features, kind), probability)
    assert ((probability >= 0) & (probability <= 1)).all()
    repeated = NetworkEnsemble.fit(features, success, kind, settings)
    assert_array_equal(repeated.probability(features, kind), probability)
    other = NetworkEnsemble.fit(features, success, kind, replace(settings, seed=1))
    assert (other.probability(features, kind) != probability).any()


def test_the_probability_is_the_mean_over_members_of_the_right_pool() -> None:
    features, success, kind = problem()
    fitted = NetworkEnsemble.fit(features, success, kind, replace(SHORT, pools_objects=False))
    probability = fitted.probability(features, kind)
    for k in range(3):
        members = [network.predict(features[kind == k]) for network in fitted.members[k]]
        assert_allclose(probability[kind == k], np.mean(members, axis=0), rtol=1e-12)
    # Objects that are not asked for are no trouble.
    some = kind == 1
    assert_array_equal(fitted.probability(features[some], kind[some]), probability[some])
    assert len(fitted.probability(features[:0], kind[:0])) == 0


def test_standardised_features_have_no_unit() -> None:
    features, success, kind = problem()
    settings = replace(SHORT, standardise=True)
    in_metres = NetworkEnsemble.fit(features, success, kind, settings)
    in_mm = NetworkEnsemble.fit(features * 1024, success, kind, settings)  # exact in binary
    assert_allclose(
        in_mm.probability(features * 1024, kind), in_metres.probability(features, kind), atol=1e-5
    )
    constant = features.copy()
    constant[:, 1] = 3.0
    fitted = NetworkEnsemble.fit(constant, success, kind, settings)
    assert np.isfinite(fitted.probability(constant, kind)).all()
    assert (fitted.scale > 0).all()


def test_each_object_learns_from_its_own_samples_only_unless_pooled() -> None:
    features, success, kind = problem()
    flipped = np.where(kind == 2, ~success, success)
    for pools_objects in (True, False):
        settings = replace(SHORT, pools_objects=pools_objects)
        one = NetworkEnsemble.fit(features, success, kind, settings).probability(features, kind)
        two = NetworkEnsemble.fit(features, flipped, kind, settings).probability(features, kind)
        same = (one == two)[kind != 2]
        assert same.all() if not pools_objects else not same.all()


def test_the_papers_protocol_is_refused() -> None:
    features, success, kind = problem()
    with pytest.raises(InputError, match="validated or last, not 'paper'"):
        NetworkEnsemble.fit(features, success, kind, replace(SHORT, protocol="paper"))


def test_few_samples_are_learned_from_without_validation() -> None:
    features, success, kind = problem(n=4, objects=2)
    fitted = NetworkEnsemble.fit(features, success, kind, replace(SHORT, pools_objects=False))
    assert np.isfinite(fitted.probability(features, kind)).all()


@pytest.mark.ill_typed
def test_arrays_that_do_not_fit_are_refused() -> None:
    features, success, kind = problem()
    fitted = NetworkEnsemble.fit(features, success, kind, SHORT)
    with pytest.raises(InputError, match="do not take 8 inputs"):
        NetworkEnsemble.from_arrays(fitted.to_arrays() | {"objects": np.array(4)})
    with pytest.raises(InputError, match="do not take 6 inputs"):
        NetworkEnsemble.from_arrays(fitted.to_arrays() | {"shift": np.zeros(3)})
    with pytest.raises(InputError, match=r"but .* scales"):
        NetworkEnsemble.from_arrays(fitted.to_arrays() | {"scale": np.ones(3)})
    lost = {k: v for k, v in fitted.to_arrays().items() if not k.startswith("0/1/weight")}
    with pytest.raises(InputError, match="do not fit together"):
        NetworkEnsemble.from_arrays(lost)
