"""Novelty detection: validity of p-values, and detection of outliers."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import synthetic
from graspcast.estimates.alignment import Estimates
from graspcast.forecasting.novelty import Disagreement, Novelty, disagreement
from graspcast.pose.transforms import rotation_from_vector

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


# --- Limits: larger than in training --------------------------------------------------------------


def diameters(given: Estimates, metres: float = 0.12) -> np.ndarray:
    return np.full(len(given), metres)


def displaced(given: Estimates, metres: float, supporter: int = 1) -> Estimates:
    """The same with one supporter moved in random directions."""
    by = np.random.default_rng(1).normal(size=(len(given), 3))
    poses = given.cam_T_obj.copy()
    poses[supporter, :, :3, 3] += metres * by / np.linalg.norm(by, axis=1, keepdims=True)
    return dataclasses.replace(given, cam_T_obj=poses)


def turned(given: Estimates, radians: float, supporter: int = 1) -> Estimates:
    poses = given.cam_T_obj.copy()
    turn = rotation_from_vector(np.array([0.0, 0.0, radians]))
    poses[supporter, :, :3, :3] = poses[supporter, :, :3, :3] @ turn
    return dataclasses.replace(given, cam_T_obj=poses)


def near(n: int, seed: int) -> Estimates:
    """Estimates of which all agree within millimetres."""
    given = synthetic.estimates(2 * n, seed=seed)
    return given.select(np.arange(2 * n) // 2 % 2 == 1)


@pytest.mark.parametrize("n", [20, 50, 100, 300])
def test_what_is_far_beyond_training_is_novel_however_few_the_training_instances(n: int) -> None:
    novelty = Novelty.fit(near(n, 0), "a", diameters(near(n, 0)))
    given = near(60, 7)
    for other in (displaced(given, 0.3), displaced(given, 0.3, 2), turned(given, 3.0)):
        found = novelty.assess(other, "a", SUPPORTERS, diameters(other))
        assert all(each.is_novel(0.01) for each in found)
        assert all(each.is_novel(0.0) for each in found), "also where any p-value is accepted"
    usual = [each.excess for each in novelty.assess(given, "a", SUPPORTERS, diameters(given))]
    assert np.mean([bool(text) for text in usual]) <= 0.05


def test_training_instances_are_within_the_limits_unless_they_contradict_each_other() -> None:
    given = synthetic.estimates(200, seed=3)
    for size in (0.01, 0.12, 5.0):
        novelty = Novelty.fit(given, "a", diameters(given, size))
        found = novelty.assess(given, "a", SUPPORTERS, diameters(given, size))
        for i, each in enumerate(found):
            apart = [
                np.linalg.norm(given.cam_T_obj[k, i, :3, 3] - given.cam_T_obj[0, i, :3, 3]) / size
                for k in (1, 2)
            ]
            assert not each.excess or max(apart) > 1


def test_limits_scale_with_the_distance_and_the_size() -> None:
    def scaled(given: Estimates, factor: float) -> Estimates:
        poses = given.cam_T_obj.copy()
        poses[..., :3, 3] *= factor
        return dataclasses.replace(given, cam_T_obj=poses)

    one = Novelty.fit(near(50, 0), "a", diameters(near(50, 0)))
    three = Novelty.fit(scaled(near(50, 0), 3.0), "a", diameters(near(50, 0), 0.36))
    assert_allclose(three.limits, one.limits, rtol=1e-9)


def test_the_limit_in_the_text_is_that_of_the_quantity() -> None:
    given = near(30, 0)
    novelty = Novelty.fit(given, "a", diameters(given))
    (said,) = {each.excess for each in novelty.assess(turned(given, 3.1), "a", SUPPORTERS)[:1]}
    assert said.startswith("b is turned by 17")
    assert "degrees from a; the limit is" in said
    (said,) = (
        each.excess
        for each in novelty.assess(displaced(given, 1.0), "a", SUPPORTERS, diameters(given))[:1]
    )
    # one metre, and objects of 0.12 m
    assert said.startswith("b is 8.3")
    assert "object diameters from a; the limit is" in said


def test_too_few_training_instances_to_tell_is_neither_novel_nor_not() -> None:
    smallest = 1 / 51
    usual = Disagreement(0.5, smallest)
    assert usual.is_novel(0.01) is None
    assert usual.is_novel(0.05) is False
    assert usual.is_novel(0.0) is False, "any p-value was asked to be accepted"
    assert usual.is_novel(0.5) is True
    assert Disagreement(0.5, smallest, "b is far").is_novel(0.01) is True
    novelty = Novelty.fit(near(50, 0), "a")
    assert novelty.smallest_p_value == pytest.approx(smallest)


@pytest.mark.ill_typed
def test_arrays_of_other_shapes_are_refused() -> None:
    arrays = fitted(0).to_arrays()
    for name, changed in (("limits", arrays["limits"][:1]), ("precision", np.eye(3))):
        with pytest.raises(ValueError, match="arrays of shapes"):
            Novelty.from_arrays(arrays | {name: changed})


def moved_alike(given: Estimates, along: float, aside: float = 0.0) -> Estimates:
    """The same with all estimators' poses moved alike, so that they agree as before."""
    poses = given.cam_T_obj.copy()
    direction = poses[0, :, :3, 3] / np.linalg.norm(poses[0, :, :3, 3], axis=1, keepdims=True)
    poses[:, :, :3, 3] += along * direction + [aside, 0.0, 0.0]
    return dataclasses.replace(given, cam_T_obj=poses)


def test_estimators_that_are_all_wrong_alike_are_novel_where_nothing_was_in_training() -> None:
    given = near(60, 0)
    novelty = Novelty.fit(given, "a", diameters(given))
    distance = np.linalg.norm(given.of("a")[:, :3, 3], axis=1)
    for other in (
        moved_alike(given, 2 * distance.max() + 1),
        moved_alike(given, 0.0, aside=10 * distance.max()),
    ):
        found = novelty.assess(other, "a", SUPPORTERS, diameters(given))
        assert all(each.is_novel(0.0) for each in found)
        assert all("a's pose is" in each.excess for each in found)
    for each in novelty.assess(moved_alike(given, 0.05), "a", SUPPORTERS, diameters(given)):
        assert "a's pose is" not in each.excess
