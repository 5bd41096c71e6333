"""What is not a sane pose is never attempted, whoever asks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import synthetic
from graspcast.bop.models import Models
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.alignment import Estimates
from graspcast.evaluation.certification import certify_forecaster
from graspcast.forecasting.fallbacks import Fallbacks
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
from graspcast.forecasting.models.mlp.types import MlpSettings
from graspcast.forecasting.pose_checks import estimate_problems, refuse_most
from graspcast.forecasting.train import train_forecaster
from graspcast.pose.transforms import rotation_from_vector, transform
from poses import random_poses, results_of, write_models

PLACEHOLDERS = [np.eye(4), np.diag([-1.0, -1.0, 1.0, 1.0]), None]


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Models]:
    folder = tmp_path_factory.mktemp("models")
    write_models(folder, obj_1={}, obj_2={})
    return {"d": Models(folder)}


@pytest.fixture(scope="module")
def forecaster(models: dict[str, Models]) -> Forecaster:
    settings = ForestSettings(trees=8, folds=0)
    return train_forecaster(synthetic.training_data(120), models=models, forests=settings)


def in_front(models: dict[str, Models]) -> np.ndarray:
    pose = random_poses(1, 8)[0]
    pose[:3, 3] = [0.01, 0.02, 4 * models["d"].info[1].diameter_m]
    return pose


def three(pose: np.ndarray) -> dict[str, np.ndarray]:
    """Three poses that agree, but not to the last digit."""
    turns = [
        transform(rotation_from_vector(np.full((1, 3), 1e-4 * k)), np.zeros(3))[0] for k in range(3)
    ]
    return {name: pose @ turn for name, turn in zip("abc", turns, strict=True)}


@pytest.mark.parametrize("nothing", PLACEHOLDERS)
def test_three_estimators_that_found_nothing_do_not_agree(
    forecaster: Forecaster, models: dict[str, Models], nothing: np.ndarray | None
) -> None:
    poses = {name: None if nothing is None else nothing.copy() for name in "abc"}
    verdict = forecaster.predict(poses, "d-1", threshold=0.0, models=models)
    assert (verdict.attempt, verdict.probability) == (False, None)
    assert verdict.reason == "no estimate by a, b, c"
    poses = {**three(in_front(models)), "b": nothing}
    verdict = forecaster.predict(poses, "d-1", threshold=0.0, models=models)
    assert (verdict.attempt, verdict.reason) == (False, "no estimate by b")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda p: p @ np.diag([1.0, 1, -1, 1]), "mirrored"),
        (lambda p: p @ np.diag([2.0, 2, 2, 1]), "scaled by 2"),
        (lambda p: np.vstack([p[:3], [[0, 0, 0, 2]]]), "last row"),
        (
            lambda p: np.diag([1.0, 1, -1, 1]) @ np.diag([1.0, 1, -1, 1]) @ np.linalg.inv(p),
            "behind",
        ),
        (lambda p: np.vstack([p[:3] * [1, 1, 1, 1000], [[0, 0, 0, 1]]]), "millimetres"),
        (lambda p: np.where(np.eye(4) == 1, np.nan, p), "not finite"),
    ],
)
def test_poses_that_cannot_be_are_abstained_from_alone_and_among_others(
    forecaster: Forecaster, models: dict[str, Models], change: object, says: str
) -> None:
    good = in_front(models)
    good[:3, :3] = np.eye(3)
    bad = change(good)  # type: ignore[operator]
    verdict = forecaster.predict(three(bad), "d-1", threshold=0.0, models=models)
    assert (verdict.attempt, verdict.probability) == (False, None)
    assert verdict.reason.startswith("no estimate by a (its pose ")
    assert says in verdict.reason
    data = synthetic.estimates(2)
    poses = np.stack([[mine, bad] for mine in three(good).values()])
    verdicts = forecaster.verdicts(
        Estimates(data.estimators, data.instances, poses), models, threshold=0.0, ood_alpha=0.0
    )
    assert verdicts[0].attempt
    assert not verdicts[1].attempt
    assert says in verdicts[1].reason


def test_one_array_for_two_estimators_is_never_attempted(
    forecaster: Forecaster, models: dict[str, Models]
) -> None:
    pose = in_front(models)
    for given in (pose, pose.copy()):
        poses = {**three(pose), "a": pose, "c": given}
        verdict = forecaster.predict(poses, "d-1", threshold=0.0, models=models)
        assert (verdict.attempt, verdict.probability) == (False, None)
        assert verdict.reason == "a and c are given one and the same pose, which always agrees"
    # What is wrong with the pose itself is said first.
    mirrored = dict.fromkeys("abc", pose @ np.diag([1.0, 1, -1, 1]))
    assert "mirrored" in forecaster.predict(mirrored, "d-1", models=models).reason
    verdict = forecaster.predict(dict.fromkeys("abc", np.eye(4)), "d-1", models=models)
    assert verdict.reason == "no estimate by a, b, c"


def test_sane_poses_have_no_problems(models: dict[str, Models]) -> None:
    given = synthetic.estimates(6)
    assert estimate_problems(given, None) == [""] * 6
    far = given.cam_T_obj.copy()
    far[1, 2, :3, 3] *= 1000
    said = estimate_problems(Estimates(given.estimators, given.instances, far), models)
    assert [bool(text) for text in said] == [False, False, True, False, False, False]
    assert "by b" in said[2]


def test_models_are_optional_but_then_distances_are_only_checked_roughly(tmp_path: Path) -> None:
    given = synthetic.estimates(2)
    far = Estimates(given.estimators, given.instances, given.cam_T_obj.copy())
    far.cam_T_obj[:, :, :3, 3] *= 15
    assert estimate_problems(far, None) == ["", ""]
    # What no gripper reaches is refused even so.
    far.cam_T_obj[:, :, :3, 3] *= 10
    assert "not in metres?" in estimate_problems(far, None)[0]


def test_nothing_is_learned_from_poses_of_another_unit(models: dict[str, Models]) -> None:
    data = synthetic.training_data(120)
    poses = data.estimates.cam_T_obj.copy()
    poses[1, :10, :3, 3] *= 100
    refuse_most(replace(data.estimates, cam_T_obj=poses), models)  # a few wild ones are usual
    poses[1, 10:, :3, 3] *= 100
    wrong = replace(data, estimates=replace(data.estimates, cam_T_obj=poses))
    with pytest.raises(InputError, match=r"120 of 120 poses by b cannot be: .* centimetres"):
        train_forecaster(wrong, models=models, forests=ForestSettings(trees=8, folds=0))


@pytest.fixture(scope="module")
def without_models(models: dict[str, Models]) -> Forecaster:
    """One that was trained with models and needs none."""
    settings = NetworkSettings(members=1, optimiser=MlpSettings(epochs=20))
    return train_forecaster(
        synthetic.training_data(120), method="MLP-O", models=models, settings=settings
    )


ODD = {
    "sane": lambda p: p,
    "none": lambda p: p | {"b": None},
    "identity": lambda p: p | {"c": np.eye(4)},
    "not finite": lambda p: p | {"b": p["b"] * np.nan},
    "masked": lambda p: p | {"b": np.ma.masked_array(p["b"], mask=True)},
    "mirrored": lambda p: p | {"b": p["b"] @ np.diag([1.0, 1, -1, 1])},
    "behind": lambda p: p | {"b": np.diag([1.0, -1, -1, 1]) @ p["b"]},
    "decimetres": lambda p: p | {"c": np.vstack([p["c"][:3] * [1, 1, 1, 30], p["c"][3:]])},
    "copy": lambda p: p | {"b": p["c"].copy()},
    "float32": lambda p: p | {"b": p["c"].astype(np.float32)},
    "near copy": lambda p: p | {"b": p["c"] + np.eye(4, k=3) * 1e-15},
}


@pytest.mark.slow
@pytest.mark.ill_typed
@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("with_models", [True, False])
def test_all_doors_give_the_same_verdict(
    without_models: Forecaster, models: dict[str, Models], odd: str, with_models: bool
) -> None:
    known = models if with_models else None
    poses = ODD[odd](three(in_front(models)))
    ask = {"threshold": 0.0, "ood_alpha": 0.0}
    one = without_models.predict(poses, "d-1", models=known, **ask)
    arrays = {name: np.eye(4) if p is None else filled(p) for name, p in poses.items()}
    keys = synthetic.estimates(1).instances
    given = Estimates(tuple(poses), keys, np.stack(list(arrays.values()))[:, None])
    (several,) = without_models.verdicts(given, known, **ask)
    assert several == one
    frame = {name: results_of(p[None]) for name, p in arrays.items()}
    (row,) = without_models.predict_frame(frame, "d", models=known, **ask)
    assert row.verdict == one
    assert Fallbacks([without_models]).predict(poses, "d-1", models=known, **ask) == one
    assert one.attempt == (odd == "sane")
    # What only forecasts has no forecast either.
    (probability,) = without_models.probability(given, known)
    assert np.isnan(probability) == (odd != "sane") == (one.probability is None)
    assert bool(without_models.explain(given, known)[0]) == (odd == "sane")


def filled(pose: np.ndarray) -> np.ndarray:
    return np.asarray(np.ma.filled(np.ma.asarray(pose, dtype=np.float64), np.nan))


def test_models_of_another_size_are_refused(
    forecaster: Forecaster, without_models: Forecaster, models: dict[str, Models]
) -> None:
    scaled = Models(models["d"].directory)
    scaled.info = {
        n: replace(info, diameter_m=2 * info.diameter_m) for n, info in scaled.info.items()
    }
    poses = three(in_front(models))
    for each in (forecaster, without_models):
        with pytest.raises(MismatchError, match=r"d-1 is .* across by its model, but was .* in tr"):
            each.predict(poses, "d-1", models={"d": scaled})


def test_what_verdicts_abstain_from_is_no_attempt_in_a_certificate(
    without_models: Forecaster,
) -> None:
    data = synthetic.training_data(240, seed=3)
    poses = data.estimates.cam_T_obj.copy()
    poses[1, ::2] = poses[0, ::2]  # copies agree perfectly
    poses[1, 1::4] = np.eye(4)
    given = replace(data, estimates=replace(data.estimates, cam_T_obj=poses))
    overall = certify_forecaster(
        without_models,
        given,
        rate=0.05,
        confidence=0.5,
        allow_training_scenes=True,
        ood_alpha=0.0,
    ).overall
    assert overall.threshold
    verdicts = without_models.verdicts(given.estimates, threshold=overall.threshold, ood_alpha=0.0)
    assert overall.attempts == sum(v.attempt for v in verdicts)
    assert 0 < overall.attempts <= 60
