"""Splits: whole scenes on one side, objects left out, validation masks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

import synthetic
from graspcast.errors import MismatchError
from graspcast.estimates.instances import scene_groups
from graspcast.forecasting.splits import Fold, by_group, by_object, fold_numbers, validation_mask
from graspcast.forecasting.training_data import TrainingData
from graspcast.paper.dataset import GRIPPERS, Published


def folds_of(samples: TrainingData, folds: int = 5, seed: int = 0) -> Iterator[Fold]:
    groups = scene_groups(samples.estimates.instances)
    return by_group(groups, samples.objects, samples.own_success == 1, folds=folds, seed=seed)


def check_folds(samples: TrainingData, folds: int, seed: int) -> None:
    groups = scene_groups(samples.estimates.instances)
    tested = []
    for train, test in folds_of(samples, folds, seed):
        assert not set(groups[train]) & set(groups[test])
        assert_array_equal(np.sort(np.concatenate([train, test])), np.arange(len(samples)))
        tested.append(test)
    assert len(tested) == folds
    assert_array_equal(np.sort(np.concatenate(tested)), np.arange(len(samples)))


@settings(max_examples=25)
@given(st.integers(2, 4), st.integers(4, 9), st.integers(0, 1000))
def test_no_scene_is_on_both_sides_and_each_sample_is_tested_once(
    folds: int, scenes: int, seed: int
) -> None:
    check_folds(synthetic.tried(60, scenes=scenes, seed=seed), folds, seed)


@pytest.mark.slow
@pytest.mark.parametrize("gripper", GRIPPERS)
def test_folds_of_the_published_samples(data: Published, gripper: str) -> None:
    samples, _ = data.tried("epos", gripper)
    check_folds(samples, 5, 0)
    scenes = np.array([f"{d}/{s}" for d, s in zip(*_where(samples), strict=True)])
    for train, test in folds_of(samples):
        both = set(scenes[train]) & set(scenes[test])
        assert both <= {"lmo/2"}  # its only scene, cut into blocks


def _where(samples: TrainingData) -> tuple[list[str], list[int]]:
    return samples.estimates.dataset.tolist(), samples.estimates.scene_id.tolist()


@pytest.mark.parametrize(("n", "objects"), [(8, (1, 2)), (8, (1, 2, 3, 4)), (50, (1, 2, 3))])
def test_outcomes_that_are_rare_are_dealt_without_complaint(
    n: int, objects: tuple[int, ...]
) -> None:
    samples = synthetic.tried(n, scenes=8, objects=objects, noise=0)
    rare = synthetic.own_outcomes(samples.estimates, np.arange(n) == 3)
    check_folds(rare, 5, 0)


def test_the_seed_deals_the_scenes() -> None:
    samples = synthetic.tried(120, scenes=12)

    def parts(seed: int) -> list[list[int]]:
        return [test.tolist() for _, test in folds_of(samples, 3, seed)]

    assert parts(1) == parts(1)
    assert parts(1) != parts(2)


def test_too_few_scenes() -> None:
    with pytest.raises(MismatchError, match="3 scenes cannot make 5 folds; ask for fewer"):
        list(folds_of(synthetic.tried(60, scenes=3)))


def test_each_object_is_left_out_once() -> None:
    samples = synthetic.tried(30, objects=(3, 1, 2))
    folds = list(by_object(samples.objects))
    assert len(folds) == 3
    for name, (train, test) in zip(("d-1", "d-2", "d-3"), folds, strict=True):
        assert set(samples.objects[test]) == {name}
        assert name not in samples.objects[train]
        assert len(train) + len(test) == 30


@given(st.lists(st.integers(0, 40), min_size=1, max_size=5), st.integers(0, 99))
def test_the_validation_set_keeps_the_share_of_each_stratum(sizes: list[int], seed: int) -> None:
    strata = np.repeat(np.arange(len(sizes)), sizes)
    part = validation_mask(strata, seed)
    assert_array_equal(part, validation_mask(strata, seed))
    for k, size in enumerate(sizes):
        assert part[strata == k].sum() == round(0.2 * size)


def test_the_seed_draws_the_validation_mask() -> None:
    strata = np.repeat([0, 1], 50)
    assert (validation_mask(strata, 0) != validation_mask(strata, 1)).any()


@given(
    st.lists(st.integers(0, 9), min_size=1, max_size=60),
    st.integers(1, 6),
    st.none() | st.integers(0, 9),
)
def test_fold_numbers_keep_groups_together_in_folds_of_equally_many_groups(
    groups: list[int], folds: int, seed: int | None
) -> None:
    names = np.array(groups)
    found = fold_numbers(names, folds, seed=seed)
    of_group = {int(name): set(found[names == name].tolist()) for name in np.unique(names)}
    assert all(len(numbers) == 1 for numbers in of_group.values())
    counts = np.bincount([number for (number,) in of_group.values()])
    assert len(counts) == min(folds, len(of_group))
    assert counts.max() - counts.min() <= 1


def test_without_a_seed_groups_are_assigned_in_turn() -> None:
    assert fold_numbers(np.array(["c", "a", "b", "d", "a"]), 3).tolist() == [2, 0, 1, 0, 0]
    many = np.arange(50)
    assert fold_numbers(many, 5, seed=1).tolist() != fold_numbers(many, 5, seed=2).tolist()


def test_outcomes_are_ignored_if_they_are_not_given() -> None:
    samples = synthetic.tried(60, scenes=6)
    groups = scene_groups(samples.estimates.instances)
    alike = synthetic.own_outcomes(samples.estimates, np.ones(60))
    without = [test.tolist() for _, test in by_group(groups, samples.objects, folds=3)]
    assert without == [test.tolist() for _, test in folds_of(alike, 3)]
