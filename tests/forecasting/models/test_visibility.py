"""Visibility models: which part answers, calibration, saved models, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.metrics import roc_auc_score

from graspcast.errors import InputError, MismatchError
from graspcast.forecasting.features import Features
from graspcast.forecasting.models.base import Predictor
from graspcast.forecasting.models.visibility import Visibility
from graspcast.forecasting.models.visibility_settings import VisibilitySettings
from graspcast.forecasting.visibility_features import visibility_features
from poses import random_poses

QUICK = VisibilitySettings(trees=10, folds=2)


class World:
    """Instances of two objects, seen better or worse; score and image fit follow it, with noise."""

    def __init__(self, n: int = 600, seed: int = 0):
        rng = np.random.default_rng(seed)
        self.seen = rng.uniform(size=n)
        self.numbers = rng.integers(0, 2, n)
        poses = random_poses(n, seed)
        score = self.seen + rng.normal(0, 0.3, n)
        fit = np.stack([self.seen + rng.normal(0, 0.1, n), rng.normal(size=n)], axis=1)
        self.features = visibility_features(poses, score, Features(("f0", "f1"), fit))
        self.success = (self.seen > rng.uniform(0.2, 0.8, n)).astype(float)
        self.groups = np.array([f"d/{i * 8 // n}" for i in range(n)])
        self.images = np.array([f"{g}/{i}" for i, g in enumerate(self.groups)])

    def fit(
        self, features: Features | None = None, success: np.ndarray | None = None, **options: object
    ) -> Visibility:
        settings = options.pop("settings", QUICK)
        objects = options.pop("objects", 2)
        return Visibility.fit(
            features or self.features,
            self.success if success is None else success,
            self.numbers,
            self.groups,
            self.images,
            objects=objects,
            settings=settings,
            **options,
        )


@pytest.fixture(scope="module")
def world() -> World:
    return World()


@pytest.fixture(scope="module")
def model(world: World) -> Visibility:
    return world.fit()


def changed(features: Features, columns: slice, value: float) -> Features:
    values = features.values.copy()
    values[:, columns] = value
    return replace(features, values=values)


def test_it_is_a_predictor_of_probabilities(world: World, model: Visibility) -> None:
    assert isinstance(model, Predictor)
    found = model.probability(world.features.values, world.numbers)
    assert ((found >= 0) & (found <= 1)).all()


def test_score_and_image_fit_each_add_to_what_new_scenes_show(model: Visibility) -> None:
    new = World(seed=1)
    rows = new.features.values
    auroc = {}
    for name, columns in (("pose", slice(6, None)), ("score", slice(7, None)), ("all", slice(0))):
        given = changed(new.features, columns, np.nan).values
        auroc[name] = roc_auc_score(new.success, model.probability(given, new.numbers))
    assert auroc["all"] > auroc["score"] + 0.02 > auroc["pose"] + 0.05
    assert len(rows) == 600


def test_each_row_rests_on_all_that_it_has(world: World, model: Visibility) -> None:
    rows = world.features.values[:5].copy()
    rows[1, 6] = np.nan
    rows[2, 7:] = np.nan
    rows[3, 6:] = np.nan
    rows[4, 0] = np.nan
    assert model.rests_on(rows, world.numbers[:5]) == (
        "the pose, its score and the image",
        "the pose and the image",
        "the pose and its score",
        "the pose",
        "",
    )
    assert np.isnan(model.probability(rows, world.numbers[:5])).tolist() == [False] * 4 + [True]


@pytest.mark.slow
def test_asked_without_images_it_equals_a_model_trained_without_them(
    world: World, model: Visibility
) -> None:
    rows, numbers = world.features.values[:, :7], world.numbers
    asked = model.probability(rows, numbers)
    unknown = changed(world.features, slice(7, None), np.nan).values
    assert_array_equal(asked, model.probability(unknown, numbers))
    without = world.fit(Features(world.features.names[:7], rows))
    assert_array_equal(asked, without.probability(rows, numbers))
    assert set(model.rests_on(rows, numbers)) == {"the pose and its score"}
    assert model.uses_image
    assert not without.uses_image


@pytest.mark.slow
def test_a_score_that_is_always_the_same_is_no_score(world: World) -> None:
    model = world.fit(changed(world.features, slice(6, 7), 0.0))
    assert "score" not in model.most
    assert set(model.parts) == {"pose", "fit"}
    assert model.rests_on(world.features.values[:1], world.numbers[:1]) == (
        "the pose and the image",
    )


@pytest.mark.slow
def test_an_object_without_images_in_training_is_answered_without(world: World) -> None:
    features = replace(world.features, values=world.features.values.copy())
    features.values[world.numbers == 1, 7:] = np.nan
    model = world.fit(features)
    told = model.rests_on(world.features.values[:50], world.numbers[:50])
    expected = {0: "the pose, its score and the image", 1: "the pose and its score"}
    assert told == tuple(expected[k] for k in world.numbers[:50].tolist())


def test_forecasts_are_calibrated_on_new_scenes(model: Visibility) -> None:
    new = World(4000, seed=2)
    p = model.probability(new.features.values, new.numbers)
    assert abs(p.mean() - new.success.mean()) < 0.05
    for low, high in ((0.0, 0.3), (0.3, 0.7), (0.7, 1.0)):
        mine = (p >= low) & (p <= high)
        assert mine.sum() > 100
        assert abs(p[mine].mean() - new.success[mine].mean()) < 0.08


@pytest.mark.slow
def test_out_of_fold_predictions_do_not_know_the_outcome(world: World, model: Visibility) -> None:
    kept = model.out_of_fold
    assert kept is not None
    assert kept.image.tolist() == world.images.tolist()
    assert_array_equal(kept.success, world.success == 1)
    own = roc_auc_score(world.success, model.probability(world.features.values, world.numbers))
    assert 0.7 < roc_auc_score(kept.success, kept.probability) < own - 0.01
    # Random outcomes cannot be forecast.
    random = np.random.default_rng(0).integers(0, 2, 600).astype(float)
    chance = world.fit(success=random).out_of_fold
    assert chance is not None
    assert abs(roc_auc_score(chance.success, chance.probability) - 0.5) < 0.08


def test_one_group_or_no_folds_leave_it_uncalibrated(world: World) -> None:
    model = world.fit(settings=replace(QUICK, folds=0))
    assert model.out_of_fold is None
    assert all(part.calibration.tolist() == [1.0, 0.0] for part in model.parts.values())


@pytest.mark.slow
def test_untried_and_unseen_instances_make_no_difference(world: World) -> None:
    success = world.success.copy()
    success[::3] = np.nan
    features = replace(world.features, values=world.features.values.copy())
    a = world.fit(features, success).probability(features.values[:9], world.numbers[:9])
    features.values[::3] = 123.0
    b = world.fit(features, success).probability(world.features.values[:9], world.numbers[:9])
    assert_array_equal(a, b)


@pytest.fixture(scope="module")
def of_three(world: World) -> Visibility:
    """A model of three objects, of whose third there are no outcomes."""
    return world.fit(objects=3)


@pytest.mark.slow
@pytest.mark.parametrize("number", [-1, 2, 5])
def test_an_unseen_object_is_refused(world: World, of_three: Visibility, number: int) -> None:
    model = of_three
    with pytest.raises(MismatchError, match="object without outcomes"):
        model.probability(world.features.values[:2], np.array([0, number]))


def test_other_columns_are_refused(world: World, model: Visibility) -> None:
    with pytest.raises(MismatchError, match="takes the 9 columns view_x"):
        model.probability(world.features.values[:, :8], world.numbers)


@pytest.mark.parametrize("success", [0.0, 1.0, np.nan])
def test_equal_outcomes_teach_nothing(world: World, success: float) -> None:
    with pytest.raises(InputError, match="both successes and failures"):
        world.fit(success=np.full(600, success))


def test_the_same_data_give_the_same_model_and_progress_ends_at_one(
    world: World, model: Visibility
) -> None:
    shares: list[float] = []
    again = world.fit(progress=lambda share, _: shares.append(share))
    assert shares[-1] == 1
    assert shares == sorted(shares)
    rows = world.features.values, world.numbers
    assert_array_equal(again.probability(*rows), model.probability(*rows))


def test_a_model_survives_being_saved(world: World, model: Visibility) -> None:
    back = Visibility.from_arrays(model.to_arrays())
    rows, numbers = world.features.values, world.numbers
    assert_array_equal(back.probability(rows, numbers), model.probability(rows, numbers))
    assert back.names == model.names
    assert back.rests_on(rows, numbers) == model.rests_on(rows, numbers)
    assert back.out_of_fold is not None
    assert model.out_of_fold is not None
    assert_array_equal(back.out_of_fold.probability, model.out_of_fold.probability)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("names", np.array(["a"])),
        ("names", np.arange(9)),
        ("pose/tried", np.array([1, 1])),
        ("score/tried", np.array([True])),
        ("fit/calibration", np.array([1.0])),
        ("pose/calibration", np.array([np.nan, 0.0])),
        ("pose/roots", np.array([0, 3], dtype=np.int32)),
    ],
)
def test_what_is_no_model_is_refused(model: Visibility, name: str, value: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        Visibility.from_arrays(model.to_arrays() | {name: value})


def test_a_part_needs_its_columns_and_probabilities_in_its_leaves(model: Visibility) -> None:
    arrays = model.to_arrays()
    with pytest.raises(ValueError, match="of which there are no columns"):
        Visibility.from_arrays(arrays | {"names": arrays["names"][:7]})
    with pytest.raises(ValueError, match="other than probabilities"):
        Visibility.from_arrays(arrays | {"pose/value": arrays["pose/value"] + 1})
    without = {name: array for name, array in arrays.items() if not name.startswith("pose/")}
    with pytest.raises(ValueError, match="pose alone"):
        Visibility.from_arrays(without)


@pytest.mark.ill_typed
@pytest.mark.parametrize("seed", range(60))
def test_damaged_arrays_are_refused_or_forecast_probabilities(
    world: World, model: Visibility, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    arrays = {name: array.copy() for name, array in model.to_arrays().items()}
    name = str(rng.choice(sorted(arrays)))
    array = arrays[name]
    match int(rng.integers(5)):
        case 0:
            del arrays[name]
        case 1:
            arrays[name] = array[: len(array) // 2]
        case 2:
            arrays[name] = array[..., None]
        case 3:
            arrays[name] = np.zeros_like(array)
        case _ if array.dtype.kind in "if":
            array[rng.integers(len(array))] = rng.integers(-5, 2000)
    try:
        read = Visibility.from_arrays(arrays)
        found = read.probability(world.features.values[:20], world.numbers[:20])
    except (ValueError, KeyError, MismatchError):
        return
    assert ((found >= 0) & (found <= 1)).all()
