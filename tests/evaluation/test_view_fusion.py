"""Fusion for every row: what is shared, what noise does, and that wrong motion is noticed."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.evaluation.benchmark import Benchmark
from graspcast.evaluation.view_fusion import Sources, fuse_benchmark, published_sources
from graspcast.evaluation.view_sets import ViewModelRule, ViewRow, view_rows
from graspcast.paper.dataset import Published
from viewed import benchmark

World = tuple[Benchmark, Sources]


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return benchmark(tmp_path_factory.mktemp("models"))


def test_rows_of_the_same_fusion_are_fused_once(world: World) -> None:
    _, sources = world
    one, other = (sources.fused(ViewRow(name, 2)) for name in ("2 views", "two"))
    assert one[0] is other[0]


def test_stated_noise_widens_and_a_motion_of_other_images_contradicts(world: World) -> None:
    _, sources = world
    (exact,) = sources.fused(ViewRow("", 3))
    (noisy,) = sources.fused(ViewRow("", 3, ViewModelRule(noise_mm=5.0)))
    assert np.median(noisy.poses.along_m) > 1.5 * np.median(exact.poses.along_m)
    (wrong,) = sources.fused(ViewRow("", 3, other_images=True))
    assert (exact.views > 1).mean() > 0.9
    assert (wrong.views > 1).mean() < 0.5


def test_one_estimator_alone_is_its_own_principal(world: World) -> None:
    _, sources = world
    (alone,) = sources.fused(ViewRow("", 3, ViewModelRule(alone="b")))
    assert alone.estimators == ("b",) and alone.principal == "b"


def test_every_rule_has_training_data_and_every_row_poses(world: World) -> None:
    found, sources = world
    rows = [row for row in view_rows(["a"]) if row.views < 5 and not row.rule.estimated][:6]
    views = fuse_benchmark(sources, found.estimates, rows)
    assert {row.rule for row in rows} == set(views.train)
    assert {row.fusion for row in rows} < set(views.test)
    assert set(np.unique(views.train[ViewModelRule()].views)) >= {1, 2, 3}
    assert views.train[ViewModelRule(alone="a")].estimators == ("a",)


@pytest.mark.slow
def test_published_instances_have_views(data: Published) -> None:
    found = Benchmark.of(data)
    sources = published_sources(data)
    rows = [ViewRow("3 views", 3)]
    views = fuse_benchmark(sources, found.estimates, rows)
    fused = views.test[rows[0].fusion]
    datasets = found.estimates.dataset[fused.data.row]
    assert (datasets == "ycbv").sum() > 1700 and (datasets == "lmo").sum() > 1200
    error = np.linalg.norm(
        fused.data.cam_T_fused[:, :3, 3] - found.truth[fused.data.row, :3, 3], axis=1
    )
    assert np.median(error) < 0.006
