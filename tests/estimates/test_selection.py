"""Selection of estimates: those of the wanted objects and scenes, held against the dataset."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from graspcast.errors import InputError
from graspcast.estimates.selection import Selection, listed
from poses import random_poses, results_of

TABLE = replace(
    results_of(random_poses(4)), obj_id=np.array([1, 1, 2, 5]), scene_id=np.array([1, 2, 2, 2])
)


def test_numbers_are_listed_with_their_runs() -> None:
    assert listed([3, 5, 4, 8, 9, 3]) == "3-5, 8, 9"
    assert listed([]) == "none"
    assert listed(range(0, 100, 2)).endswith("38, …")


def test_the_wanted_rows() -> None:
    assert Selection().of(TABLE, "kit") is TABLE
    assert Selection(["1", "kit-5", "bin-2"]).of(TABLE, "kit").obj_id.tolist() == [1, 1, 5]
    assert Selection(["1"], [2]).of(TABLE, "kit").obj_id.tolist() == [1]
    assert Selection(["my-kit-2"]).of(TABLE, "my-kit").obj_id.tolist() == [2]
    assert len(Selection(["7"]).of(TABLE, "kit")) == 0


@pytest.mark.parametrize("name", ["mug", "kit-", "-1", "kit-one", "1.5", "", "²"])
def test_an_object_is_a_number_or_dataset_and_number(name: str) -> None:
    with pytest.raises(InputError, match=r"NUMBER, or DATASET-NUMBER \(lmo-5\), not") as caught:
        Selection([name])
    assert caught.value.parameters == ("objects",)


def test_wanted_objects_that_nothing_has_are_told() -> None:
    wanted = Selection(["1", "7", "kit-2", "bin-2"])
    assert wanted.lacking_in({"kit": {"a": TABLE}}) == ["7", "bin-2"]
    wanted.check_datasets(["my"])
    with pytest.raises(InputError, match="objects bin-2: there are only estimates of dataset kit"):
        Selection(["bin-2"]).check_datasets(["kit"])
