"""Trials of verdicts, of looks, and held out in training."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl
import pytest

from graspcast.bop.models import Models
from graspcast.estimates.instances import InstanceKey
from graspcast.evaluation.cross_validation import cross_validate
from graspcast.evaluation.threshold_trials import (
    held_out,
    stored_trials,
    threshold_in_use,
    trials_of_looks,
    trials_of_verdicts,
)
from graspcast.evaluation.verdict_scores import verdict_table
from graspcast.forecasting.train import fit_forecaster
from graspcast.forecasting.training_data import TrainingData
from graspcast.forecasting.verdict import InstanceLooks, Verdict, VerdictRow
from graspcast.views.next_look import NextLook
from poses import write_models
from synthetic import estimates, own_outcomes

AHEAD = np.array([0.0, 0.0, 1.0])
AGAIN = NextLook(AHEAD, AHEAD, AHEAD, 0.01, 1.0, None)


def row(i: int, p: float | None, *, at: float | None = 0.5, views: int = 1) -> VerdictRow:
    attempt = p is not None and at is not None and p >= at
    verdict = Verdict(attempt, p, "why", at)
    return VerdictRow(
        InstanceKey("d", i // 2, i, 5, 0), "a", "hand", verdict, np.eye(4), views=views
    )


def outcomes(rows: list[VerdictRow], success: list[int | None]) -> pl.DataFrame:
    held = pl.Series("success", success, dtype=pl.Int64)
    return (
        verdict_table(rows).with_columns(held).drop_nulls("success").drop("attempt", "probability")
    )


def test_of_verdicts() -> None:
    rows = [row(0, 0.9, views=2), row(1, 0.3), row(2, None), row(3, 0.8)]
    rows[3] = replace(rows[3], verdict=replace(rows[3].verdict, out_of_distribution=True))
    said = trials_of_verdicts(rows)
    assert said.success is None
    np.testing.assert_array_equal(said.probability[:, 0], [0.9, 0.3, np.nan, np.nan])
    assert said.looks[:, 0].tolist() == said.ended.tolist() == [2, 1, 1, 1]
    assert said.scenes.tolist() == ["d/0", "d/0", "d/1", "d/1"]
    came = trials_of_verdicts(rows, outcomes(rows, [1, None, 0, 1]))
    assert came.success is not None
    assert came.success[:, 0].tolist() == [1, 0, 1]
    assert len(came.scenes) == 3
    assert threshold_in_use(rows) == 0.5
    assert threshold_in_use([row(0, 0.9), row(1, 0.9, at=0.7)]) is None
    assert threshold_in_use([row(0, None, at=None)]) is None


def test_of_looks_after_the_end_nothing_counts() -> None:
    def again(one: VerdictRow) -> VerdictRow:
        return replace(one, verdict=replace(one.verdict, look=AGAIN))

    looks = [
        InstanceLooks((row(0, 0.9), row(0, 0.95)), 1),  # attempted at once
        InstanceLooks((again(row(1, 0.2)), row(1, 0.7)), 2),
        InstanceLooks((row(2, 0.1),), 1),  # there was one image
    ]
    found = trials_of_looks(looks)
    np.testing.assert_array_equal(found.probability, [[0.9, np.nan], [0.2, 0.7], [0.1, np.nan]])
    assert found.ended.tolist() == [1, 2, 1]
    attempted, _, taken = found.at(0.5)
    assert attempted.tolist() == [True, True, False]
    assert taken.tolist() == [1, 2, 1]
    attempted, _, taken = found.at(0.15)
    assert attempted.tolist() == [True, True, False]
    assert taken.tolist() == [1, 1, 1]
    rows = [looks[0].rows[0], looks[1].rows[0], looks[2].rows[0]]
    came = trials_of_looks(looks, outcomes(rows, [1, 0, None]))
    assert came.success is not None
    assert came.success.tolist() == [[1, 1], [0, 0]]


@pytest.fixture(scope="module")
def held(tmp_path_factory: pytest.TempPathFactory) -> tuple[TrainingData, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("made")
    write_models(folder, obj_1={}, obj_2={})
    given = estimates(240, scenes=12)
    rng = np.random.default_rng(1)
    far = (np.arange(240) // 2) % 2 == 0
    success = np.where(rng.random(240) < 0.1, far, ~far).astype(float)
    return own_outcomes(given, success), {
        "method": "direct",
        "models": {"d": Models(folder)},
    }


@pytest.mark.slow
def test_held_out_scores_are_those_of_cross_validation(
    held: tuple[TrainingData, dict[str, Any]],
) -> None:
    data, how = held
    how = {**how, "folds": 3, "seed": 2}
    found = held_out(data, **how)
    assert list(found) == ["unseen_scenes"]
    mine = found["unseen_scenes"]
    assert mine.scores == cross_validate(data, **how)
    assert len(set(mine.trials.scenes.tolist())) == 12
    assert mine.trials.ended.max() == 1


@pytest.mark.slow
def test_stored_ones_are_the_out_of_fold_predictions(
    held: tuple[TrainingData, dict[str, Any]],
) -> None:
    data, how = held
    forecaster = fit_forecaster(data, **how)
    found = stored_trials(forecaster)
    assert found is not None and found.success is not None
    assert len(found.scenes) == 240 and len(set(found.scenes.tolist())) == 12
    assert found.success.mean() == pytest.approx(data.own_success.mean())
