"""Scenes and blocks of frames."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import synthetic
from graspcast.errors import InputError
from graspcast.estimates.instances import object_name, scene_groups, split_object_name


@given(st.integers(5, 80), st.integers(1, 5), st.randoms())
def test_the_only_scene_is_cut_into_contiguous_blocks(n: int, blocks: int, random: Random) -> None:
    estimates = synthetic.estimates(n, scenes=1)
    shuffled = estimates.select(np.random.default_rng(random.getrandbits(32)).permutation(n))
    groups = scene_groups(shuffled.instances, blocks=blocks)
    names, sizes = np.unique(groups, return_counts=True)
    assert names.tolist() == [f"d/0#{b}" for b in range(blocks)]
    assert sizes.max() - sizes.min() <= 1
    in_order = groups[np.argsort(shuffled.im_id)]
    assert (np.sort(in_order) == in_order).all()


def test_an_image_stays_in_one_block_and_other_datasets_are_not_cut() -> None:
    one = synthetic.estimates(40, scenes=1)
    one = synthetic.with_keys(one, im_id=one.im_id // 4)
    groups = scene_groups(one.instances)
    for image in np.unique(one.im_id):
        assert len(set(groups[one.im_id == image])) == 1
    assert set(scene_groups(synthetic.estimates(40, scenes=4).instances)) == {
        f"d/{s}" for s in range(4)
    }


@pytest.mark.parametrize("name", ["lmo-5", "a-b-0", "d-1000000"])
def test_a_name_is_split_and_put_together(name: str) -> None:
    assert object_name(*split_object_name(name)) == name


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("mustard", "DATASET-NUMBER"),
        ("lmo-", "DATASET-NUMBER"),
        ("-5", "DATASET-NUMBER"),
        ("lmo-" + "9" * 5000, "DATASET-NUMBER.*…"),
        ("lmo-05", "an object's name is lmo-5, not 'lmo-05'"),
        ("lmo-\u0665", "an object's name is lmo-5, not"),
    ],
)
def test_no_object_has_two_names(name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        split_object_name(name)
