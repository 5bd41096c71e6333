"""Novelty detection: validity of p-values, and detection of outliers."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import synthetic
from graspcast.estimates.alignment import Estimates
from graspcast.forecasting.novelty import Novelty, disagreement

TRAINING, HELD_OUT = 300, 400
SUPPORTERS = ("b", "c")


def fitted(seed: int, *, scenes: int = 10) -> Novelty:
    return Novelty.fit(synthetic.estimates(TRAINING, seed=seed, scenes=scenes), "a")


def test_at_most_a_share_a_of_held_out_instances_has_a_or_less() -> None:
    worlds = 40
    held_out = np.stack(
        [
            fitted(10 * i).p_value(synthetic.estimates(HELD_OUT, seed=10 * i + 5), "a", SUPPORTERS)
            for i in range(worlds)
        ]
    )
    for share in (0.01, 0.05, 0.1, 0.3, 0.5):
        # Trials and calibration scores both vary; three standard errors of the mean over worlds.
        each = (held_out <= share).mean(axis=1)
        error = each.std() / np.sqrt(worlds)
        assert each.mean() <= share + 3 * error, share
    # and it is no empty promise
    assert (held_out <= 0.3).mean() > 0.2


def test_p_values_are_ranks_among_the_scores() -> None:
    novelty = fitted(0)
    found = novelty.p_value(synthetic.estimates(HELD_OUT, seed=5), "a", SUPPORTERS)
    ranks = found * (TRAINING + 1)
    assert_allclose(ranks, np.round(ranks), atol=1e-9)
    assert ranks.min() >= 1 - 1e-9
    assert found.max() <= 1
    assert_array_equal(novelty.scores, np.sort(novelty.scores))
    assert len(novelty.scores) == TRAINING


def outlier(given: Estimates, supporter: int) -> Estimates:
    poses = given.cam_T_obj.copy()
    poses[supporter, :, :3, 3] += [5.0, -3.0, 8.0]
    return dataclasses.replace(given, cam_T_obj=poses)


@pytest.mark.parametrize("supporter", [1, 2])
def test_a_gross_outlier_has_the_smallest_p_value(supporter: int) -> None:
    unusual = outlier(synthetic.estimates(20, seed=5), supporter)
    found = fitted(0).p_value(unusual, "a", SUPPORTERS)
    assert_array_equal(found, 1 / (TRAINING + 1))


def test_perfect_agreement_is_what_it_is_and_others_beside_it_change_nothing() -> None:
    novelty = fitted(0)
    given = synthetic.estimates(50, seed=5)
    expected = novelty.p_value(given, "a", SUPPORTERS)
    unusual = outlier(given, 1)
    mixed = dataclasses.replace(
        given,
        cam_T_obj=np.where(
            (np.arange(50) < 25)[None, :, None, None], given.cam_T_obj, unusual.cam_T_obj
        ),
    )
    found = novelty.p_value(mixed, "a", SUPPORTERS)
    assert_array_equal(found[:25], expected[:25])
    assert (found[25:] < expected[25:]).all()
    order = given.only("c", "a", "b")
    assert_array_equal(novelty.p_value(order, "a", SUPPORTERS), expected)
    assert_allclose(disagreement(given, "a", ("a",)), 0, atol=1e-12)


def test_one_scene_is_enough_and_arrays_come_back() -> None:
    single = synthetic.with_keys(synthetic.estimates(40), im_id=np.zeros(40, np.int64))
    single = synthetic.with_keys(single, scene_id=np.zeros(40, np.int64))
    novelty = Novelty.fit(single, "a")
    assert np.isfinite(novelty.scores).all()
    again = Novelty.from_arrays(novelty.to_arrays())
    given = synthetic.estimates(30, seed=2)
    assert_array_equal(
        again.p_value(given, "a", SUPPORTERS), novelty.p_value(given, "a", SUPPORTERS)
    )
