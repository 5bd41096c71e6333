"""Growing of blends: several guides share forests, and a view model is calibrated by all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from graspcast.errors import InputError
from graspcast.forecasting.models.blend import Blend, ForestSettings
from graspcast.forecasting.models.growing import grow_blends
from graspcast.forecasting.models.targets import Targets
from looked_at import Training, training

SETTINGS = ForestSettings(trees=6, folds=2, draws=16)
TARGETS = Targets.of_objects(("d-1", "d-2"))


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Training:
    return training(tmp_path_factory.mktemp("given"))


@pytest.fixture(scope="module")
def blends(given: Training) -> dict[str, Blend]:
    return grow_blends(given.data, ("a", "c"), TARGETS, given.models, SETTINGS)


def test_guides_share_all_but_their_error_model_and_calibration(blends: dict[str, Blend]) -> None:
    a, c = blends["a"], blends["c"]
    assert a.direct is c.direct and a.views is c.views
    assert a.success_given_error is c.success_given_error
    assert a.errors is not c.errors and (a.estimator != c.estimator).any()


@pytest.mark.slow
def test_one_guide_alone_is_grown_the_same(given: Training, blends: dict[str, Blend]) -> None:
    alone = grow_blends(given.data, ("c",), TARGETS, given.models, SETTINGS)["c"]
    for name, array in alone.to_arrays().items():
        assert_array_equal(array, blends["c"].to_arrays()[name])


def test_views_are_calibrated_by_out_of_fold_forecasts_of_every_guide(
    given: Training, blends: dict[str, Blend]
) -> None:
    views = blends["a"].views
    assert views is not None and views.out_of_fold is not None
    assert views.calibration[0] > 0 and tuple(views.calibration) != (1.0, 0.0)
    probability, success = views.out_of_fold.probability, views.out_of_fold.success
    assert given.data.views is not None
    assert len(probability) == 3 * (given.data.views.views > 1).sum()
    assert abs(probability.mean() - success.mean()) < 0.02
    assert probability[success].mean() > probability[~success].mean() + 0.2


def test_one_estimator_alone_learns_from_views(given: Training) -> None:
    one = training_of_one(given)
    blend = grow_blends(one, ("a",), TARGETS, given.models, SETTINGS)["a"]
    assert blend.direct is None and blend.errors is None and blend.views is not None
    with pytest.raises(InputError, match="nothing to learn from"):
        grow_blends(replace(one, views=None), ("a",), TARGETS, given.models, SETTINGS)
    back = Blend.from_arrays(blend.to_arrays())
    assert_array_equal(back.known, blend.known)
    with pytest.raises(ValueError, match="a part of the model is missing"):
        arrays = {k: v for k, v in blend.to_arrays().items() if not k.startswith("views/")}
        Blend.from_arrays(arrays)


def training_of_one(given: Training):  # type: ignore[no-untyped-def]
    from graspcast.forecasting.view_data import view_data
    from looked_at import fused

    alone = given.data.only("a")
    tables = {"a": given.results["a"]}
    parts = [fused(tables, given.models, given.motion, n) for n in (1, 3)]
    assert np.isnan(alone.success).sum() == 0
    return replace(alone, views=view_data(alone.estimates, parts, {}))
