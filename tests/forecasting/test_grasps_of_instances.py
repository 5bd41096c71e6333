"""Forecasters that know several grasps of each object."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import synthetic
from graspcast.bop.models import Models
from graspcast.errors import FormatError, UnknownNameError
from graspcast.evaluation.certification import certify_forecaster
from graspcast.evaluation.cross_validation import cross_validate
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.train import fit_forecaster
from graspcast.forecasting.training_data import TrainingData
from poses import write_models

SMALL = ForestSettings(trees=8, draws=16, folds=2)
NAMES = {"reference", "g1", "g2"}


@dataclass
class Given:
    data: TrainingData
    forecaster: Forecaster
    models: dict[str, Models]

    def fitted(self, data: TrainingData, **options: object) -> Forecaster:
        options = {"models": self.models, "forests": SMALL, "guides": ("a",), **options}
        return fit_forecaster(data, **options)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Given:
    root = tmp_path_factory.mktemp("models")
    write_models(root / "models", obj_1={}, obj_2={})
    data = synthetic.several_grasps(240)
    data.others["g2"][:, data.objects == "d-2"] = np.nan  # a grasp of the first object alone
    out = Given(data, None, {"d": Models(root / "models")})  # type: ignore[arg-type]
    out.forecaster = out.fitted(data, guides=("a", "b"))
    return out


def test_all_grasps_of_the_object_are_ranked_by_probability(given: Given) -> None:
    ranked = given.forecaster.rank(given.data.estimates, given.models)
    for name, some in zip(given.data.objects.tolist(), ranked, strict=True):
        assert {each.grasp for each in some} == (NAMES if name == "d-1" else NAMES - {"g2"})
        p = [each.probability for each in some]
        assert p == sorted(p, reverse=True)
        assert {each.outcomes for each in some} == {360}
    best = given.forecaster.probability(given.data.estimates, given.models)
    assert_array_equal(best, [some[0].probability for some in ranked])


def complementary(seed: int) -> TrainingData:
    """A grasp that succeeds where the estimators agree, and one that does where they do not."""
    data = synthetic.several_grasps(240, seed=seed)
    place = data.estimates.cam_T_obj[:, :, :3, 3]
    agree = np.linalg.norm(place[0] - place[1], axis=-1) < 0.02
    agree ^= np.random.default_rng(seed).random(240) < 0.1
    success = np.tile(agree.astype(float), (3, 1))
    return dataclasses.replace(data, success=success, others={"g1": 1 - success})


@pytest.mark.slow
def test_choosing_for_each_instance_is_better_than_any_one_grasp(given: Given) -> None:
    forecaster, fresh = given.fitted(complementary(0)), complementary(5)
    ranked = forecaster.rank(fresh.estimates, given.models)
    chosen = fresh.outcome_of([some[0].grasp for some in ranked])
    assert not np.isnan(chosen).any()
    assert chosen.mean() > fresh.own_outcomes.mean(axis=1).max() + 0.25
    p = np.array([some[0].probability for some in ranked])
    assert abs(p.mean() - chosen.mean()) < 0.08


def test_a_verdict_is_on_the_best_grasp_and_ranks_the_others(given: Given) -> None:
    estimates = given.data.estimates
    verdicts = given.forecaster.verdicts(estimates, given.models)
    ranked = given.forecaster.rank(estimates, given.models)
    for verdict, some in zip(verdicts, ranked, strict=True):
        assert (verdict.grasp, verdict.probability) == (some[0].grasp, some[0].probability)
        assert verdict.grasps == some
        assert f"grasp {verdict.grasp}, the best of {len(some)}, by 360 outcomes" in verdict.reason
    poses = {name: estimates.of(name)[0] for name in "abc"}
    one = given.forecaster.predict(poses, "d-1", models=given.models)
    assert (one.grasp, one.grasps) == (verdicts[0].grasp, verdicts[0].grasps)


def test_only_what_is_reachable_is_chosen(given: Given) -> None:
    poses = {name: given.data.estimates.of(name)[0] for name in "abc"}
    for grasp in sorted(NAMES):
        verdict = given.forecaster.predict(poses, "d-1", models=given.models, reachable=[grasp])
        assert verdict.grasp == grasp and len(verdict.grasps) == 1
        asked = given.data.estimates.select(np.array([0]))
        alone = given.forecaster.probability(asked, given.models, grasp=grasp)
        assert verdict.probability == alone[0]
    none = given.forecaster.predict(poses, "d-1", models=given.models, reachable=[])
    assert not none.attempt and none.probability is None
    assert none.reason == (
        "no grasp is reachable of those that the model knows of d-1: g1, g2, reference"
    )
    with pytest.raises(UnknownNameError, match="'g7'"):
        given.forecaster.predict(poses, "d-1", models=given.models, reachable=["g7"])


def test_some_instances_may_reach_nothing(given: Given) -> None:
    estimates = given.data.estimates
    keys = estimates.instances.to_keys()
    mask = {key: ["g1"] for key in keys[::2]}
    verdicts = given.forecaster.verdicts(estimates, given.models, reachable=mask)
    for i, verdict in enumerate(verdicts):
        assert (verdict.probability is None) == (i % 2 == 1)
        assert verdict.grasp == ("reference" if i % 2 else "g1")
    found = given.forecaster.rank(estimates, given.models, reachable=mask)
    assert [len(some) for some in found] == [1, 0] * (len(keys) // 2)


def test_an_unknown_grasp_cannot_be_forecast(given: Given) -> None:
    with pytest.raises(UnknownNameError, match=r"grasp of d-2 'g2'.*known: g1, reference"):
        given.forecaster.probability(given.data.estimates, given.models, grasp="g2")


@pytest.mark.slow
def test_the_order_of_grasps_makes_no_difference(given: Given) -> None:
    others = dict(reversed(given.data.others.items()))
    again = given.fitted(dataclasses.replace(given.data, others=others), guides=("a", "b"))
    asked = given.data.estimates, given.models
    for one, two in zip(given.forecaster.rank(*asked), again.rank(*asked), strict=True):
        assert [each.grasp for each in one] == [each.grasp for each in two]
        assert_allclose([e.probability for e in one], [e.probability for e in two], atol=0.15)


@pytest.mark.slow
def test_novelty_and_the_error_model_do_not_depend_on_grasps(given: Given) -> None:
    one = given.fitted(given.data.of_grasp())
    several = given.forecaster
    assert not one.card.grasps
    estimates = given.data.estimates
    assert_array_equal(one.p_value(estimates), several.p_value(estimates))
    assert_array_equal(one.predictor.errors.truth, several.predictor.errors.truth)  # type: ignore
    assert_array_equal(one.predictor.errors.members, several.predictor.errors.members)  # type: ignore


@pytest.mark.slow
def test_a_grasp_with_one_outcome_is_last_and_said_to_rest_on_it(given: Given) -> None:
    rare = np.full_like(given.data.success, np.nan)
    rare[0, 0] = 1.0
    data = dataclasses.replace(given.data, others={**given.data.others, "rare": rare})
    forecaster = given.fitted(data)
    poses = {name: given.data.estimates.of(name)[0] for name in "abc"}
    verdict = forecaster.predict(poses, "d-1", models=given.models)
    assert verdict.grasps[-1].grasp == "rare" and verdict.grasp != "rare"
    alone = forecaster.predict(poses, "d-1", models=given.models, reachable=["rare"])
    assert "grasp rare, by 1 outcome alone" in alone.reason


def test_a_model_file_keeps_all_of_it(given: Given, tmp_path: Path) -> None:
    given.forecaster.save(tmp_path / "m.npz")
    again = Forecaster.load(tmp_path / "m.npz")
    asked = given.data.estimates, given.models
    assert again.rank(*asked) == given.forecaster.rank(*asked)
    assert again.card == given.forecaster.card
    assert again.guided_by("b").rank(*asked) == given.forecaster.guided_by("b").rank(*asked)
    cut = dataclasses.replace(given.forecaster.card, grasps={"d-1": {"g1": 3}, "d-2": {"g1": 3}})
    dataclasses.replace(given.forecaster, card=cut, others=()).save(tmp_path / "m.npz")
    with pytest.raises(FormatError, match="not a complete model file"):
        Forecaster.load(tmp_path / "m.npz")


@pytest.mark.slow
def test_scores_and_certificates_are_of_the_chosen_grasps(given: Given) -> None:
    scores = cross_validate(given.data, folds=2, models=given.models, forests=SMALL)
    assert scores.n == 240 and scores.auroc > 0.6
    fresh = synthetic.several_grasps(240, seed=5)
    fresh.others["g2"][:, fresh.objects == "d-2"] = np.nan
    options = {"unit": "image", "models": given.models, "allow_training_scenes": True}
    found = certify_forecaster(given.forecaster, fresh, rate=0.7, **options)
    assert found.provenance["grasp"] == ["g1", "g2", "reference"]
    assert found.provenance["without_outcome"] == 0
    lacking = certify_forecaster(given.forecaster, fresh.of_grasp(), rate=0.7, **options)
    assert lacking.provenance["without_outcome"] > 0


@pytest.mark.slow
def test_simulated_trials_teach_grasps_without_outcomes(given: Given) -> None:
    trials = synthetic.error_outcomes(300, "d-2", seed=3)
    wide = np.ones(300, dtype=bool)
    wide[:5] = False
    named = dataclasses.replace(trials, success=wide, grasps=np.array(["wide"] * 300))
    data = dataclasses.replace(given.data, simulated=named)
    forecaster = given.fitted(data)
    assert forecaster.card.grasps["d-2"]["wide"] == 300
    assert forecaster.card.simulated == ()
    fresh = synthetic.training_data(240, seed=5).estimates
    place = fresh.cam_T_obj[:, :, :3, 3]
    unsure = np.linalg.norm(place[0] - place[1], axis=-1) > 0.02
    second = fresh.select((fresh.objects == "d-2") & unsure)
    best = [some[0].grasp for some in forecaster.rank(second, given.models)]
    assert best.count("wide") > 0.9 * len(best)


def test_one_estimator_is_ranked_by_visibility() -> None:
    data = synthetic.several_grasps(240).only("a")
    forecaster = fit_forecaster(data, forests=SMALL)
    assert forecaster.visibility is not None
    ranked = forecaster.rank(data.estimates)
    assert all(len(some) == 3 for some in ranked)
    verdict = forecaster.verdicts(data.estimates)[0]
    assert "the best of 3" in verdict.reason and "one view of one estimator" in verdict.reason
