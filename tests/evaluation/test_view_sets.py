"""Rows of the tables with several views, and fused poses by row."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.evaluation.view_fusion import Sources
from graspcast.evaluation.view_sets import ViewModelRule, ViewRow, ViewSet, view_rows
from viewed import benchmark


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> tuple[ViewSet, int]:
    found, sources = benchmark(tmp_path_factory.mktemp("models"))
    assert isinstance(sources, Sources)
    return ViewSet.of(found.estimates, sources.fused(ViewRow("3 views", 3))), len(found)


def test_keys_are_unique_and_averaging_shares_the_fusion() -> None:
    rows = view_rows(["a", "b"])
    assert len({row.key for row in rows}) == len(rows)
    averaged = [row for row in rows if row.averaged]
    assert averaged and all(any(r.fusion == a.fusion for r in rows if r != a) for a in averaged)
    assert {row.rule for row in rows} >= {ViewModelRule(alone="a"), ViewModelRule(noise_mm=3.0)}


def test_instances_with_several_views_are_there(world: tuple[ViewSet, int]) -> None:
    found, n = world
    assert found.data.row.tolist() == list(range(n))
    assert (found.gathered == 3).all() and (found.data.views == 3).mean() > 0.9


def test_selected_rows_keep_their_poses(world: tuple[ViewSet, int]) -> None:
    found, n = world
    chosen = np.array([7, 3, 50])
    part = found.select(chosen, n)
    poses = found.data.cam_T_fused
    for row, pose, number in zip(part.data.row, part.data.cam_T_fused, part.number, strict=True):
        np.testing.assert_array_equal(pose, poses[chosen[row]])
        np.testing.assert_array_equal(pose, found.fused[0].poses.cam_T_obj[number])
    assert sorted(part.data.row.tolist()) == [0, 1, 2]
