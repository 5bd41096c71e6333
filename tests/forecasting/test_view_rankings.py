"""Rankings of grasps with several views."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from graspcast import Episode, Forecaster
from graspcast.bop.models import Models
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.train import fit_forecaster
from graspcast.forecasting.view_rankings import view_probabilities, view_ranking
from graspcast.views.fused_estimates import FusedEstimates
from graspcast.views.statistics import fusion_statistics
from looked_at import fused, training


@dataclass
class World:
    forecaster: Forecaster
    models: dict[str, Models]
    fused: FusedEstimates


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    """A second grasp of the first object holds wherever the first fails, but for large errors."""
    given = training(tmp_path_factory.mktemp("views"))
    other = np.where(given.data.objects == "d-1", 1 - given.data.success, np.nan)
    data = replace(given.data, others={"top": other})
    settings = ForestSettings(trees=8, folds=2)
    forecaster = fit_forecaster(data, models=given.models, forests=settings)
    return World(forecaster, given.models, fused(given.results, given.models, given.motion))


@pytest.mark.slow
def test_each_guide_has_the_grasp_that_is_best_with_its_pose(world: World) -> None:
    views = world.fused
    several = np.flatnonzero(views.views > 1)
    keys, poses = views.instances.select(several), views.poses.cam_T_obj[several]
    given = keys, fusion_statistics(views)[several], poses, poses, world.models
    ranking = view_ranking(world.forecaster, *given)
    assert_array_equal(view_probabilities(world.forecaster, *given), ranking.probability)
    rows = world.forecaster.judge(views, world.models, guide="fused")
    for i, ranked in zip(several.tolist(), ranking.grasps, strict=True):
        assert len(ranked) == (2 if rows[i].key.obj_id == 1 else 1)
        assert rows[i].verdict.grasps == ranked
        assert rows[i].grasp == rows[i].verdict.grasp == ranked[0].grasp
        assert_allclose(rows[i].verdict.probability, ranked[0].probability)
    best = world.forecaster.judge(views, world.models, guide="best")
    for i in several.tolist():
        assert best[i].verdict.probability >= rows[i].verdict.probability - 1e-12


def test_only_what_is_reachable_guides(world: World) -> None:
    keys = world.fused.instances.to_keys()
    mask = {key: ["reference"] for key in keys[::2]}
    rows = world.forecaster.judge(world.fused, world.models, guide="best", reachable=mask)
    for i, row in enumerate(rows):
        assert row.grasp == "reference"
        assert ("no grasp is reachable" in row.verdict.reason) == (i % 2 == 1)
        assert (row.verdict.probability is None) == (i % 2 == 1)


def test_a_further_look_is_expected_to_help_the_chosen_grasp(world: World) -> None:
    rows = world.forecaster.judge(
        world.fused, world.models, guide="fused", threshold=1.0, max_looks=9, min_gain=0.0
    )
    expected = [r.verdict.look.expected_probability for r in rows if r.verdict.look is not None]
    assert expected and all(p is not None and 0 < p < 1 for p in expected)


def test_an_episode_ranks_the_grasps_and_takes_the_robot_s_mask(world: World) -> None:
    one = world.fused.gathered
    first = int(np.flatnonzero(world.fused.instances.obj_id == 1)[0])
    poses = dict(zip(world.fused.estimators, one.view_T_obj[first, 0], strict=True))
    episode = Episode(world.forecaster, "d-1", models=world.models, max_looks=1)
    verdict = episode.look(poses)
    assert {each.grasp for each in verdict.grasps} == {"reference", "top"}
    assert verdict.grasp == verdict.grasps[0].grasp
    episode.forget()
    assert episode.look(poses, reachable=["top"]).grasp == "top"
    episode.forget()
    none = episode.look(poses, reachable=[])
    assert not none.attempt and "no grasp is reachable" in none.reason
