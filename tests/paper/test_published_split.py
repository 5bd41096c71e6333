"""The published split: lookup of instances, and damaged files."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

import synthetic
from graspcast.errors import FormatError
from graspcast.paper.published_split import published_part, read_split


def test_a_sample_that_the_split_does_not_know_has_no_part() -> None:
    estimates = synthetic.estimates(4)
    keys = {"dataset": ["d"], "scene_id": [0], "im_id": [1], "obj_id": [2], "split": ["test"]}
    split = pl.DataFrame({"principal": ["a"], "gripper": ["parallel"], **keys})
    split = split.with_columns(scene_id=pl.lit(int(estimates.scene_id[1])))
    assert published_part(estimates, "a", "parallel", split).tolist() == ["", "test", "", ""]
    other = split.with_columns(principal=pl.lit("b"))
    assert published_part(estimates, "a", "parallel", other).tolist() == [""] * 4


HEADER = "principal,gripper,dataset,scene_id,im_id,obj_id,split\n"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("principal,gripper,dataset,scene_id,im_id,obj_id\n", "no column split"),
        (HEADER + "a,parallel,d,1,2,3,validation\n", "should be train or test, but holds"),
        ("", "is not a CSV file"),
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
