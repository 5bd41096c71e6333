"""Forecasters of one estimator: one view by visibility, several by the view model, saved whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import graspcast
import one_estimator as world
from graspcast import Episode, Episodes, Forecaster
from graspcast.errors import FormatError, InputError, MismatchError
from graspcast.evaluation.cross_validation import cross_validate, cross_validated_with_views
from graspcast.forecasting.features import Features
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.training_data import TrainingData
from graspcast.io.arrays import read_arrays, write_arrays
from looked_at import CAMERAS, Training, fused, training

QUICK = ForestSettings(trees=8, folds=2)
FIT = ("fit_a", "fit_b")


@pytest.fixture(scope="module")
def data() -> TrainingData:
    """Score and two numbers of image fit, the latter not of every fourth instance."""
    given = world.seen().data
    rng = np.random.default_rng(0)
    fit = given.own_success[None] + rng.normal(0, 0.3, (2, len(given)))
    fit[:, ::4] = np.nan
    seen = given.estimates.seen | {name: row[None] for name, row in zip(FIT, fit, strict=True)}
    return replace(given, estimates=replace(given.estimates, seen=seen))


@pytest.fixture(scope="module")
def forecaster(data: TrainingData) -> Forecaster:
    with pytest.warns(match="one estimator: from one view forecasts rest on the object and the"):
        return graspcast.train_forecaster(data, forests=QUICK)


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> Training:
    return training(tmp_path_factory.mktemp("views"), names=("a",))


@pytest.fixture(scope="module")
def with_views(views: Training) -> Forecaster:
    with pytest.warns(match="one estimator"):
        return graspcast.train_forecaster(views.data, models=views.models, forests=QUICK)


def test_it_answers_by_all_that_is_known(data: TrainingData, forecaster: Forecaster) -> None:
    assert forecaster.card.supporters == ()
    assert forecaster.card.method == forecaster.card.features == "visibility"
    assert not forecaster.needs_models
    verdicts = forecaster.verdicts(data.estimates, threshold=0.5)
    probability = forecaster.probability(data.estimates)
    assert [v.probability for v in verdicts] == probability.tolist()
    has_fit = np.isfinite(data.estimates.seen["fit_a"][0])
    for verdict, fit in zip(verdicts, has_fit.tolist(), strict=True):
        rests = "the pose, its score and the image" if fit else "the pose and its score"
        assert f"one view of one estimator: rests on {rests}, mostly visibility" in verdict.reason
        assert verdict.attempt is (verdict.probability >= 0.5)
        assert verdict.out_of_distribution is None
        assert verdict.p_value is None
    assert np.isnan(forecaster.p_value(data.estimates)).all()
    assert repr(forecaster) == "Forecaster(visibility: a alone; p gripper, 2 objects, 96 samples)"


def test_one_instance_is_judged_as_among_many(data: TrainingData, forecaster: Forecaster) -> None:
    verdicts = forecaster.verdicts(data.estimates, threshold=0.5)
    seen = {name: values[0] for name, values in data.estimates.seen.items()}
    for i in (1, 2, 4, 50):
        pose, name = data.estimates.cam_T_obj[0, i], data.objects[i]
        fit = Features(FIT, np.array([[seen[n][i] for n in FIT]]))
        given = {"score": seen["score"][i], "image_fit": fit}
        assert forecaster.predict({"a": pose}, name, **given) == verdicts[i]
    bare = forecaster.predict({"a": pose}, name)
    assert "rests on the pose, mostly" in bare.reason
    with pytest.raises(InputError, match="image fit is of 2 instances"):
        forecaster.predict({"a": pose}, name, image_fit=Features(FIT, np.zeros((2, 2))))
    with pytest.raises(MismatchError, match="was not trained for d-7"):
        forecaster.predict({"a": pose}, "d-7")
    assert forecaster.predict({"a": None}, name).probability is None


def test_the_explanation_names_what_it_rests_on(data: TrainingData, forecaster: Forecaster) -> None:
    found = forecaster.explain(data.estimates)
    fitted = np.isfinite(data.estimates.seen["fit_a"][0])
    assert {name for name, _ in found[1]} == {"its score", "image fit", "place in the image"}
    for row, fit in zip(found, fitted.tolist(), strict=True):
        assert fit or dict(row)["image fit"] == 0
    verdict = forecaster.verdicts(data.estimates, explain=True)[1]
    assert "attributed to" in verdict.reason


def test_a_pose_elsewhere_than_in_training_is_abstained_from(
    data: TrainingData, forecaster: Forecaster
) -> None:
    poses = data.estimates.cam_T_obj.copy()
    poses[0, 3, 2, 3] = 3.0
    far = replace(data.estimates, cam_T_obj=poses)
    verdicts = forecaster.verdicts(far, threshold=0.0)
    assert [v.attempt for v in verdicts] == [i != 3 for i in range(len(verdicts))]
    assert verdicts[3].out_of_distribution is True
    assert "a's pose is 3.0" in verdicts[3].reason


@pytest.mark.slow
def test_an_object_without_outcomes_is_abstained_from(data: TrainingData) -> None:
    success = data.success.copy()
    success[:, data.objects == "d-2"] = np.nan
    forecaster = _fitted(replace(data, success=success))
    assert forecaster.card.objects == ("d-1",)
    verdicts = forecaster.verdicts(data.estimates, threshold=0.0)
    assert [v.attempt for v in verdicts] == (data.objects == "d-1").tolist()
    found = forecaster.probability(data.estimates, unseen_objects=True)
    assert_array_equal(np.isnan(found), data.objects == "d-2")


def _fitted(data: TrainingData, **options: object) -> Forecaster:
    with pytest.warns(match="one estimator"):
        return graspcast.train_forecaster(data, forests=QUICK, **options)  # type: ignore[arg-type]


def test_a_score_that_says_nothing_is_none(data: TrainingData) -> None:
    seen = {"score": np.zeros((1, len(data)))}
    forecaster = _fitted(replace(data, estimates=replace(data.estimates, seen=seen)))
    said = {v.reason.split(": ")[-1] for v in forecaster.verdicts(data.estimates)}
    assert said == {"rests on the pose, mostly visibility"}


@pytest.mark.slow
def test_a_saved_model_answers_to_the_bit(
    data: TrainingData, forecaster: Forecaster, with_views: Forecaster, tmp_path: Path
) -> None:
    forecaster.save(tmp_path / "one.npz")
    loaded = Forecaster.load(tmp_path / "one.npz")
    assert loaded.card == forecaster.card
    assert loaded.card.digest == forecaster.card.digest
    assert loaded.verdicts(data.estimates, explain=True) == forecaster.verdicts(
        data.estimates, explain=True
    )
    with_views.save(tmp_path / "many.npz")
    again = Forecaster.load(tmp_path / "many.npz")
    assert again.visibility is not None
    poses = {"a": data.estimates.cam_T_obj[0, 0]}
    assert again.predict(poses, "d-1", score=0.7) == with_views.predict(poses, "d-1", score=0.7)
    assert_array_equal(again.typical, with_views.typical)


@pytest.mark.parametrize(
    ("kind", "lost", "said"),
    [
        ("one", "0/predictor/pose/roots", "the part that needs the pose alone is missing"),
        ("one", "0/novelty/view", "view"),
        ("one", "0/typical", "typical"),
        ("many", "0/predictor/visibility/", "a part of the model is missing"),
        ("many", "0/novelty/", "centre"),
    ],
)
def test_a_damaged_file_is_refused(
    forecaster: Forecaster, with_views: Forecaster, tmp_path: Path, kind: str, lost: str, said: str
) -> None:
    path = tmp_path / "m.npz"
    (forecaster if kind == "one" else with_views).save(path)
    arrays = read_arrays(path, "train it again")
    kept = {name: array for name, array in arrays.items() if not name.startswith(lost)}
    assert len(kept) < len(arrays)
    write_arrays(path, kept)
    with pytest.raises(FormatError, match=f"not a complete model file .*{said}.*train it again"):
        Forecaster.load(path)


def test_a_file_of_before_says_why_it_does_not_answer_one_view(views: Training) -> None:
    # What was trained without this model: the two-stage method alone still is.
    forecaster = graspcast.train_forecaster(
        views.data, models=views.models, forests=QUICK, method="two-stage"
    )
    assert forecaster.visibility is None
    verdict = forecaster.verdicts(views.data.estimates, views.models)[0]
    assert verdict.probability is None
    assert "nothing that could contradict it" in verdict.reason


@pytest.mark.slow
def test_one_file_answers_for_one_view_and_for_several(
    views: Training, with_views: Forecaster
) -> None:
    assert (with_views.card.method, with_views.card.features) == ("blend", "visibility")
    assert with_views.view_model is not None
    several = with_views.judge(fused(views.results, views.models, views.motion), views.models)
    assert all("3 views" in row.verdict.reason for row in several)
    assert not any("visibility" in row.verdict.reason for row in several)
    one = fused(views.results, views.models, views.motion, 1)
    single = with_views.judge(one, views.models, threshold=0.9)
    # The scores are those of the results.
    expected = with_views.verdicts(views.data.estimates, views.models, threshold=0.9)
    assert [row.verdict for row in single] == expected
    assert all("rests on the pose and its score" in row.verdict.reason for row in single)
    known = with_views.judge(one, views.models, threshold=0.9, seen={})
    assert all("rests on the pose, mostly" in row.verdict.reason for row in known)
    single, several = cross_validated_with_views(
        views.data, models=views.models, folds=2, forests=ForestSettings(trees=8, folds=2)
    )
    assert np.isfinite(single).all()
    assert np.isfinite(several).any()


def test_a_look_of_one_estimator_is_answered_and_asks_for_another(
    views: Training, with_views: Forecaster, forecaster: Forecaster
) -> None:
    table = views.results["a"]
    place = (table.scene_id == 1) & (table.obj_id == 2)
    poses = table.cam_T_obj[place]
    episode = Episode(with_views, "d-2", models=views.models, threshold=0.999, max_looks=2)
    first = episode.look({"a": poses[0]}, CAMERAS[0])
    assert str(first) == "look again"
    assert first.probability is not None
    assert "one view of one estimator: rests on the pose, mostly visibility" in first.reason
    assert first.reason.count("one view") == 1
    assert first.look is not None
    assert first.look.expected_probability is not None
    second = episode.look({"a": poses[1]}, CAMERAS[1])
    assert second.views == 2
    assert "2 views" in second.reason
    # With its score; and without a view model there is a direction, and no expectation.
    alone = Episode(forecaster, "d-2", threshold=0.999)
    found = alone.look({"a": poses[0]}, score=0.1)
    assert str(found) == "look again"
    assert "rests on the pose and its score, mostly visibility" in found.reason
    assert found.look is not None
    assert found.look.expected_probability is None
    expected = forecaster.predict({"a": poses[0]}, "d-2", score=0.1)
    assert found.probability == expected.probability
    episodes = Episodes(with_views, "d", models=views.models, threshold=0.0)
    (one, two) = episodes.look({"a": table.select((table.scene_id == 1) & (table.im_id == 0))})
    assert one.attempt and two.attempt
    assert "rests on the pose and its score, mostly visibility" in one.reason


def test_what_cannot_be_learned_is_told(data: TrainingData, views: Training) -> None:
    for method in ("threshold", "MLP", "two-stage"):
        with pytest.raises(InputError, match=f"the method {method} takes at least two estimators"):
            graspcast.train_forecaster(data, method=method)
    with pytest.raises(InputError, match="too few to learn"):
        graspcast.train_forecaster(data.select(np.arange(5)))
    with pytest.raises(InputError, match="one estimator alone learns nothing of objects"):
        cross_validate(data, by="object", forests=QUICK)


@pytest.mark.slow
def test_it_forecasts_scenes_that_it_has_not_seen(data: TrainingData) -> None:
    assert cross_validate(data, forests=QUICK, folds=3).auroc > 0.75
