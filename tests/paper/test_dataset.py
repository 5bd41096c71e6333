"""The published data: counts of instances, and their split."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest

from graspcast.paper.dataset import ESTIMATORS, Published


@pytest.mark.parametrize(("gripper", "count"), [("parallel", 3010), ("underactuated", 3152)])
@pytest.mark.parametrize("principal", ESTIMATORS)
def test_the_published_samples(data: Published, principal: str, gripper: str, count: int) -> None:
    samples, part = data.tried(principal, gripper)
    assert len(data.estimates) == 3152
    assert len(samples) == len(part) == count
    assert samples.is_tried.all()
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
