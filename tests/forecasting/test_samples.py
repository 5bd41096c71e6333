"""Samples: joining estimates with outcomes, the published split, splits that keep scenes apart."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from random import Random

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

import synthetic
from graspcast.errors import FormatError, MismatchError, UnknownNameError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.instances import scene_groups
from graspcast.forecasting.samples import Samples, join
from graspcast.forecasting.splits import by_object, by_scene
from graspcast.paper.dataset import ESTIMATORS, GRIPPERS, Published
from graspcast.paper.published_split import published_part, read_split


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
    samples = join(given_, shuffled, "a", "parallel")
    assert samples.success.tolist() == [bool(s) for s in success]
    assert_array_equal(samples.estimates.cam_T_obj, given_.cam_T_obj)
    assert samples.untried == 0


def test_instances_of_one_object_in_one_image_are_told_apart() -> None:
    given_ = synthetic.with_keys(
        synthetic.estimates(3, objects=(1,), scenes=1),
        im_id=np.zeros(3, int),
        est_id=np.array([2, 0, 1]),
    )
    table = trials(given_, [1, 0, 1])
    assert join(given_, table, "a", "parallel").success.tolist() == [True, False, True]
    first = table.filter(pl.col("est_id") == 1)
    samples = join(given_, first, "a", "parallel")
    assert samples.estimates.est_id.tolist() == [1]
    assert samples.success.tolist() == [True]
    assert samples.untried == 2


def test_what_was_not_tried_is_left_out_and_counted() -> None:
    given_ = synthetic.estimates(6)
    table = trials(given_, [1] * 6)
    others = table.with_columns(estimator=pl.lit("b")), table.with_columns(gripper=pl.lit("hand"))
    samples = join(given_, pl.concat([table[1:4], *others]), "a", "parallel")
    assert len(samples) == 3
    assert samples.untried == 3
    assert samples.estimates.im_id.tolist() == [1, 2, 3]
    chosen = samples.select(np.array([True, False, True]))
    assert chosen.estimates.im_id.tolist() == [1, 3]
    assert (chosen.principal, chosen.gripper, chosen.untried) == ("a", "parallel", 3)


def test_messages_list_what_there_is() -> None:
    given_ = synthetic.estimates(4)
    table = trials(given_, [1, 0, 1, 0])
    with pytest.raises(UnknownNameError, match="unknown estimator 'z'; known: a, b, c"):
        join(given_, table, "z", "parallel")
    with pytest.raises(UnknownNameError, match=r"'paralel' \(did you mean 'parallel'\?\); known"):
        join(given_, table, "a", "paralel")
    with pytest.raises(MismatchError, match=r"no instance has an outcome of b .* of a on d"):
        join(given_, table, "b", "parallel")
    elsewhere = table.with_columns(dataset=pl.lit("e"))
    with pytest.raises(MismatchError, match="there are outcomes of a on e"):
        join(given_, elsewhere, "a", "parallel")


# --- The published split --------------------------------------------------------------------------


@pytest.mark.parametrize(("gripper", "count"), [("parallel", 3010), ("underactuated", 3152)])
@pytest.mark.parametrize("principal", ESTIMATORS)
def test_the_published_samples(data: Published, principal: str, gripper: str, count: int) -> None:
    samples, part = data.samples(principal, gripper)
    assert len(data.estimates) == 3152
    assert len(samples) == len(part) == count
    assert samples.untried == 3152 - count
    assert set(part) == {"train", "test"}
    for name in np.unique(samples.objects):
        mine = part[samples.objects == name]
        assert (mine == "test").mean() == pytest.approx(0.2, abs=0.02), name
    written = data.split.filter(
        pl.col("principal") == principal, pl.col("gripper") == gripper, pl.col("split") == "test"
    )
    egg_carton = (pl.col("dataset") == "lmo") & (pl.col("obj_id") == 10)
    if gripper == "parallel":
        written = written.filter(~egg_carton)
    assert (part == "test").sum() == len(written)


def test_a_sample_that_the_split_does_not_know_has_no_part() -> None:
    samples = synthetic.samples(4)
    keys = {"dataset": ["d"], "scene_id": [0], "im_id": [1], "obj_id": [2], "split": ["test"]}
    split = pl.DataFrame({"principal": ["a"], "gripper": ["parallel"], **keys})
    row = (samples.estimates.im_id == 1).nonzero()[0]
    split = split.with_columns(scene_id=pl.lit(int(samples.estimates.scene_id[row[0]])))
    assert published_part(samples, split).tolist() == ["", "test", "", ""]
    other = split.with_columns(principal=pl.lit("b"))
    assert published_part(samples, other).tolist() == [""] * 4


HEADER = "principal,gripper,dataset,scene_id,im_id,obj_id,split\n"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("principal,gripper,dataset,scene_id,im_id,obj_id\n", "no column split"),
        (HEADER + "a,parallel,d,1,2,3,validation\n", "should be train or test, but holds"),
        ("", "cannot be read"),
    ],
)
def test_a_damaged_split_is_refused(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "split.csv"
    path.write_text(text)
    with pytest.raises(FormatError, match=says) as caught:
        read_split(path)
    assert str(path) in str(caught.value)


def test_a_missing_split_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="cannot be read"):
        read_split(tmp_path / "split.csv")


# --- Splits that keep scenes apart ----------------------------------------------------------------


def check_folds(samples: Samples, folds: int, seed: int) -> None:
    groups = scene_groups(samples.estimates.instances)
    tested = []
    for train, test in by_scene(samples, folds=folds, seed=seed):
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
    check_folds(synthetic.samples(60, scenes=scenes, seed=seed), folds, seed)


@pytest.mark.parametrize("gripper", GRIPPERS)
def test_folds_of_the_published_samples(data: Published, gripper: str) -> None:
    samples, _ = data.samples("epos", gripper)
    check_folds(samples, 5, 0)
    scenes = np.array([f"{d}/{s}" for d, s in zip(*_where(samples), strict=True)])
    for train, test in by_scene(samples):
        both = set(scenes[train]) & set(scenes[test])
        assert both <= {"lmo/2"}  # its only scene, cut into blocks


def _where(samples: Samples) -> tuple[list[str], list[int]]:
    return samples.estimates.dataset.tolist(), samples.estimates.scene_id.tolist()


@given(st.integers(5, 80), st.integers(1, 5), st.randoms())
def test_the_only_scene_is_cut_into_contiguous_blocks(n: int, blocks: int, random: Random) -> None:
    estimates = synthetic.estimates(n, scenes=1)
    shuffled = estimates.select(np.random.default_rng(random.getrandbits(32)).permutation(n))
    groups = scene_groups(shuffled, blocks=blocks)
    names, sizes = np.unique(groups, return_counts=True)
    assert names.tolist() == [f"d/0#{b}" for b in range(blocks)]
    assert sizes.max() - sizes.min() <= 1
    in_order = groups[np.argsort(shuffled.im_id)]
    assert (np.sort(in_order) == in_order).all()


def test_an_image_stays_in_one_block_and_other_datasets_are_not_cut() -> None:
    one = synthetic.estimates(40, scenes=1)
    one = synthetic.with_keys(one, im_id=one.im_id // 4)
    groups = scene_groups(one)
    for image in np.unique(one.im_id):
        assert len(set(groups[one.im_id == image])) == 1
    assert set(scene_groups(synthetic.estimates(40, scenes=4))) == {f"d/{s}" for s in range(4)}


@pytest.mark.parametrize(("n", "objects"), [(8, (1, 2)), (8, (1, 2, 3, 4)), (50, (1, 2, 3))])
def test_outcomes_that_are_rare_are_dealt_without_complaint(
    n: int, objects: tuple[int, ...]
) -> None:
    samples = synthetic.samples(n, scenes=8, objects=objects, noise=0)
    rare = dataclasses.replace(samples, success=np.arange(n) == 3)
    check_folds(rare, 5, 0)


def test_the_seed_deals_the_scenes() -> None:
    samples = synthetic.samples(120, scenes=12)

    def parts(seed: int) -> list[list[int]]:
        return [test.tolist() for _, test in by_scene(samples, folds=3, seed=seed)]

    assert parts(1) == parts(1)
    assert parts(1) != parts(2)


def test_too_few_scenes() -> None:
    with pytest.raises(MismatchError, match="3 scenes cannot make 5 folds; ask for fewer"):
        list(by_scene(synthetic.samples(60, scenes=3)))


def test_each_object_is_left_out_once() -> None:
    samples = synthetic.samples(30, objects=(3, 1, 2))
    left_out = dict(by_object(samples))
    assert list(left_out) == ["d-1", "d-2", "d-3"]
    for name, (train, test) in left_out.items():
        assert set(samples.objects[test]) == {name}
        assert name not in samples.objects[train]
        assert len(train) + len(test) == 30
