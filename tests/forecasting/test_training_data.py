"""Training data: joins of estimates with outcomes, and simulated trials."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import synthetic
from graspcast.bop.results import Results
from graspcast.errors import FormatError, MismatchError, UnknownNameError
from graspcast.estimates.alignment import Estimates, align
from graspcast.estimates.outcomes import ERROR_COLUMNS, error_numbers
from graspcast.forecasting.simulated_trials import SimulatedTrials
from graspcast.forecasting.training_data import TrainingData
from poses import random_poses, results_of

NAMES = ("a", "b", "c")


def outcomes(given: Estimates, seed: int = 0) -> pl.DataFrame:
    rng = np.random.default_rng(seed)
    parts = [
        pl.DataFrame(
            {
                "dataset": given.dataset.tolist(),
                "scene_id": given.scene_id,
                "im_id": given.im_id,
                "obj_id": given.obj_id,
                "est_id": given.est_id,
                "success": rng.integers(0, 2, len(given)),
            }
        ).with_columns(estimator=pl.lit(name), gripper=pl.lit(gripper))
        for name in NAMES
        for gripper in ("parallel", "hand")
    ]
    return pl.concat(parts)


def crowded() -> Estimates:
    """Twelve images of one object; images 3 and 4 show it twice, the others once."""
    given = synthetic.estimates(14, objects=(1,))
    image = np.array([0, 1, 2, 3, 3, 4, 4, 5, 6, 7, 8, 9, 10, 11])
    instance = np.array([0, 0, 0, 0, 1, 0, 1, 0, 0, 0, 0, 0, 0, 0])
    return synthetic.with_keys(given, scene_id=np.zeros(14, np.int64), im_id=image, est_id=instance)


def test_other_estimators_outcomes_count_only_where_the_object_appears_once() -> None:
    given = crowded()
    table = outcomes(given)
    data = TrainingData.join(given, table, "b", "parallel")
    several = np.isin(given.im_id, [3, 4])
    mine = table.filter(gripper="parallel")
    for k, name in enumerate(NAMES):
        expected = mine.filter(estimator=name)["success"].to_numpy().astype(float)
        if name != "b":
            expected = np.where(several, np.nan, expected)
        assert_array_equal(data.success[k], expected)
    assert len(data.tried()) == 14
    assert_array_equal(data.own_success, mine.filter(estimator="b")["success"].to_numpy())


def test_outcomes_of_other_instances_and_grippers_do_not_matter() -> None:
    given = synthetic.estimates(40)
    kept = given.select(np.arange(40) < 25)
    table = outcomes(given)
    foreign = (pl.col("im_id") >= 25) | (pl.col("gripper") == "hand")
    flipped = table.with_columns(
        success=pl.when(foreign).then(1 - pl.col("success")).otherwise(pl.col("success"))
    )
    assert not flipped.equals(table)
    one, two = (TrainingData.join(kept, each, "a", "parallel") for each in (table, flipped))
    assert_array_equal(one.success, two.success)
    assert np.isfinite(one.success).all()
    shuffled = TrainingData.join(
        kept, table.sample(fraction=1, shuffle=True, seed=1), "a", "parallel"
    )
    assert_array_equal(shuffled.success, one.success)


def test_what_is_not_known_is_nan_and_selecting_keeps_rows_together() -> None:
    given = synthetic.estimates(20)
    table = outcomes(given).filter(pl.col("im_id") % 3 == 0)
    truth = synthetic.true_poses(20)
    truth[5] = np.nan
    data = TrainingData.join(given, table, "a", "parallel", truth=truth)
    assert_array_equal(np.isnan(data.success), np.tile(np.arange(20) % 3 != 0, (3, 1)))
    assert_array_equal(data.has_truth, np.arange(20) != 5)
    assert_array_equal(data.tried().estimates.im_id, np.arange(0, 20, 3))
    part = data.select(np.array([9, 5, 0]))
    assert_array_equal(part.estimates.im_id, [9, 5, 0])
    assert_array_equal(part.has_truth, [True, False, True])
    assert_array_equal(part.success, data.success[:, [9, 5, 0]])
    nothing = TrainingData.join(given, None, "a", "parallel")
    assert np.isnan(nothing.success).all()
    assert not nothing.has_truth.any()
    with pytest.raises(MismatchError, match=r"no instance has an outcome of a with the parallel"):
        nothing.tried()


def test_unknown_names() -> None:
    given = synthetic.estimates(6)
    with pytest.raises(UnknownNameError, match=r"unknown estimator 'z'; known: a, b, c"):
        TrainingData.join(given, outcomes(given), "z", "parallel")
    with pytest.raises(UnknownNameError, match=r"'paralel' .did you mean 'parallel'"):
        TrainingData.join(given, outcomes(given), "a", "paralel")


# --- Simulated trials -----------------------------------------------------------------------------


def campaign(path: Path, trials: SimulatedTrials, gripper: str) -> Path:
    names = [name.rpartition("-") for name in trials.objects.tolist()]
    frame = pl.DataFrame(
        {
            "estimator": "transferred",
            "dataset": [dataset for dataset, _, _ in names],
            "scene_id": 0,
            "im_id": np.arange(len(trials)),
            "obj_id": [int(number) for _, _, number in names],
            "gripper": gripper,
            "success": trials.success.astype(int),
        }
    ).with_columns(
        pl.Series(name, column)
        for name, column in zip(ERROR_COLUMNS, error_numbers(trials.obj_T_est).T, strict=True)
    )
    path.mkdir()
    frame.write_parquet(path / "outcomes.parquet")
    return path


@pytest.mark.slow
def test_simulated_trials_of_one_gripper_from_several_campaigns(tmp_path: Path) -> None:
    first, second, other = (
        synthetic.error_outcomes(n, name, seed=n)
        for n, name in ((20, "d-1"), (30, "e-2"), (9, "d-1"))
    )
    paths = [
        campaign(tmp_path / "one", first, "parallel"),
        campaign(tmp_path / "two", second, "parallel"),
        campaign(tmp_path / "three", other, "hand"),
    ]
    found = SimulatedTrials.read(paths, "parallel")
    assert len(found) == 50
    assert found.objects.tolist() == ["d-1"] * 20 + ["e-2"] * 30
    assert_allclose(found.obj_T_est, np.concatenate([first.obj_T_est, second.obj_T_est]), atol=1e-9)
    assert_array_equal(found.success, np.concatenate([first.success, second.success]))
    chosen = found.select(found.objects == "e-2")
    assert_array_equal(chosen.success, second.success)
    assert len(SimulatedTrials.read(paths, "hand")) == 9
    with pytest.raises(
        MismatchError,
        match=r"trial of the foot gripper; there are trials of hand, parallel",
    ):
        SimulatedTrials.read(paths, "foot")
    with pytest.raises(FormatError, match=r"none"):
        SimulatedTrials.read([tmp_path / "none.parquet"], "parallel")


def trials(estimates: Estimates, success: list[int], estimator: str = "a") -> pl.DataFrame:
    return pl.DataFrame(
        {
            "estimator": [estimator] * len(estimates),
            "dataset": estimates.dataset.tolist(),
            "scene_id": estimates.scene_id,
            "im_id": estimates.im_id,
            "obj_id": estimates.obj_id,
            "est_id": estimates.est_id,
            "gripper": ["parallel"] * len(estimates),
            "success": success,
        }
    )


def test_outcomes_find_their_instances_whatever_their_order() -> None:
    given_ = synthetic.estimates(9)
    success = [1, 0, 0, 1, 1, 0, 1, 0, 0]
    shuffled = trials(given_, success).sample(fraction=1, shuffle=True, seed=3)
    data = TrainingData.join(given_, shuffled, "a", "parallel")
    assert data.own_success.tolist() == success
    assert data.is_tried.all()
    assert_array_equal(data.tried().estimates.cam_T_obj, given_.cam_T_obj)


def test_several_instances_of_one_object_in_one_image() -> None:
    given_ = synthetic.with_keys(
        synthetic.estimates(3, objects=(1,), scenes=1),
        im_id=np.zeros(3, int),
        est_id=np.array([2, 0, 1]),
    )
    table = trials(given_, [1, 0, 1])
    assert TrainingData.join(given_, table, "a", "parallel").own_success.tolist() == [1, 0, 1]
    first = table.filter(pl.col("est_id") == 1)
    tried = TrainingData.join(given_, first, "a", "parallel").tried()
    assert tried.estimates.est_id.tolist() == [1]
    assert tried.own_success.tolist() == [1]


def test_only_the_principals_trials_with_the_gripper_count_as_tried() -> None:
    given_ = synthetic.estimates(6)
    table = trials(given_, [1] * 6)
    others = table.with_columns(estimator=pl.lit("b")), table.with_columns(gripper=pl.lit("hand"))
    data = TrainingData.join(given_, pl.concat([table[1:4], *others]), "a", "parallel")
    assert data.is_tried.tolist() == [False, True, True, True, False, False]
    tried = data.tried()
    assert tried.estimates.im_id.tolist() == [1, 2, 3]
    chosen = tried.select(np.array([True, False, True]))
    assert chosen.estimates.im_id.tolist() == [1, 3]
    assert (chosen.principal, chosen.gripper) == ("a", "parallel")


def test_messages_list_what_there_is() -> None:
    given_ = synthetic.estimates(4)
    table = trials(given_, [1, 0, 1, 0])
    with pytest.raises(UnknownNameError, match="unknown estimator 'z'; known: a, b, c"):
        TrainingData.join(given_, table, "z", "parallel")
    with pytest.raises(UnknownNameError, match=r"'paralel' \(did you mean 'parallel'\?\); known"):
        TrainingData.join(given_, table, "a", "paralel")
    with pytest.raises(MismatchError, match=r"no instance has an outcome of b .* of a on d"):
        TrainingData.join(given_, table, "b", "parallel")
    elsewhere = table.with_columns(dataset=pl.lit("e"))
    with pytest.raises(MismatchError, match=r"there are outcomes of a on e \(objects \d"):
        TrainingData.join(given_, elsewhere, "a", "parallel")


# --- Several instances of an object in an image ---------------------------------------------------


def detections(name_score: list[float], seed: int) -> Results:
    """Three detections of one object in each of 20 images."""
    poses = random_poses(60, seed)
    poses[:, :3, 3] = np.tile([[0, 0, 1], [0.3, 0, 1], [0, 0.3, 1]], (20, 1))
    return dataclasses.replace(
        results_of(poses),
        scene_id=np.zeros(60, int),
        im_id=np.repeat(np.arange(20), 3),
        obj_id=np.ones(60, int),
        score=np.tile(name_score, 20),
    )


def outcomes_by(column: str, estimator: str = "a") -> pl.DataFrame:
    n = np.arange(60)
    return pl.DataFrame(
        {
            "estimator": [estimator] * 60,
            "dataset": ["d"] * 60,
            "scene_id": n * 0,
            "im_id": n // 3,
            "obj_id": n * 0 + 1,
            column: n % 3,
            "gripper": ["hand"] * 60,
            "success": n % 2,
        }
    )


def test_former_numbers_of_tied_estimates_are_refused() -> None:
    other = detections([0.9, 0.5, 0.1], 2)
    distinct = align({"a": detections([0.9, 0.5, 0.1], 1), "b": other}, dataset="d")
    tied = align({"a": detections([0.9, 0.9, 0.1], 1), "b": other}, dataset="d")
    former, current = outcomes_by("inst_id"), outcomes_by("est_id")
    expected = TrainingData.join(distinct, current, "a", "hand").own_success
    assert_array_equal(TrainingData.join(distinct, former, "a", "hand").own_success, expected)
    assert len(TrainingData.join(tied, current, "a", "hand").tried()) == 60
    with pytest.raises(MismatchError, match=r"d-1 in image 0/0, est_id 0: a gave several"):
        TrainingData.join(tied, former, "a", "hand")


def test_incomplete_instances_make_unstated_outcomes_ambiguous() -> None:
    whole = detections([0.9, 0.5, 0.1], 1)
    first = detections([0.9, 0.5, 0.1], 2).select(np.arange(0, 60, 3))
    estimates = align({"a": whole, "b": first}, dataset="d")
    assert len(estimates) == 20
    unstated = outcomes_by("est_id").filter(est_id=1).drop("est_id")
    with pytest.raises(MismatchError, match="several instances of d-1, but the outcomes have no"):
        TrainingData.join(estimates, unstated, "a", "hand")


def test_supporters_outcomes_are_not_used_where_they_found_an_object_twice() -> None:
    one = detections([0.9, 0.5, 0.1], 1).select(np.arange(0, 60, 3))
    estimates = align({"a": one, "b": detections([0.9, 0.5, 0.1], 2)}, dataset="d")
    both = pl.concat([outcomes_by("est_id", n).filter(est_id=0) for n in "ab"])
    data = TrainingData.join(estimates, both, "a", "hand")
    assert not np.isnan(data.success[0]).any()
    assert np.isnan(data.success[1]).all()
