"""Forecasts from several views of all estimators, and of the principal alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from graspcast.errors import InputError
from graspcast.estimates.loading import Inputs
from graspcast.evaluation.principal_forecasts import PrincipalForecasts, forecast_principals
from graspcast.evaluation.principal_views import (
    PrincipalViews,
    ViewForecasts,
    fuse_principals,
    view_forecasts,
)
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.splits import by_group
from graspcast.forecasting.train import fit_forecaster
from graspcast.forecasting.view_verdicts import judge
from graspcast.views.camera_motion import CameraMotion
from looked_at import CAMERAS, Training, fused, training
from synthetic import with_keys

FAST: dict[str, Any] = {"folds": 2, "forests": ForestSettings(trees=6, draws=16, folds=0)}


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Training:
    made = training(tmp_path_factory.mktemp("given"), names=("a", "b"))
    return made._replace(data=replace(made.data, views=None))


@pytest.fixture(scope="module")
def views(given: Training) -> PrincipalViews:
    inputs = Inputs({}, {"d": given.results})
    heard: list[float] = []
    found = fuse_principals(
        inputs,
        {"d": given.motion},
        [given.data],
        max_views=3,
        views_from="all",
        progress=lambda share, _: heard.append(share),
    )
    assert heard == sorted(heard) and heard[-1] == 1.0
    return found["a"]


@pytest.fixture(scope="module")
def single(given: Training) -> PrincipalForecasts:
    return forecast_principals([given.data], models=given.models, **FAST)[0]


@pytest.fixture(scope="module")
def found(given: Training, views: PrincipalViews, single: PrincipalForecasts) -> ViewForecasts:
    return view_forecasts(given.data, views, single, models=given.models, **FAST)


def test_forecasts_of_each_number_of_views_are_of_the_same_grasps(found: ViewForecasts) -> None:
    assert set(found.forecasts) == {(("a", "b"), v) for v in (1, 2, 3)} | {(("a",), 2), (("a",), 3)}
    first = found.forecasts[("a", "b"), 1]
    for each in found.forecasts.values():
        assert_array_equal(each.success, first.success)
        assert_array_equal(each.scenes, first.scenes)
    assert found.without_views == 0


def test_a_forecast_is_that_of_a_forecaster_without_the_scene(
    given: Training, views: PrincipalViews, found: ViewForecasts
) -> None:
    """Train without the scenes of a fold, and judge its instances as predict would."""
    for names, part in ((("a", "b"), views.together), (("a",), views.alone)):
        forecast = found.forecasts[names, 2]
        data = given.data.only(*names)
        scene = forecast.scenes
        folds = by_group(scene, data.objects, data.own_success == 1, folds=2, seed=0)
        train, test = next(iter(folds))
        assert not set(scene[train]) & set(scene[test])
        mine = replace(data, views=part.train).select(np.isin(np.arange(len(data)), train))
        forecaster = fit_forecaster(mine, models=given.models, forests=FAST["forests"])
        results = {name: given.results[name] for name in names}
        rows = judge(forecaster, fused(results, given.models, given.motion, 2), given.models)
        by_key = {row.key: row for row in rows}
        keys = given.data.estimates.instances.to_keys()
        compared = 0
        for i in test.tolist():
            row = by_key[keys[i]]
            if row.views == 2 and row.verdict.probability is not None:
                compared += 1
                assert forecast.probability[i] == pytest.approx(row.verdict.probability)
        assert compared > len(test) / 2


def test_more_views_of_one_estimator_rank_grasps_that_one_view_of_two_do_not(
    found: ViewForecasts,
) -> None:
    def auroc(names: tuple[str, ...], views: int) -> float:
        each = found.forecasts[names, views]
        held, failed = each.probability[each.success], each.probability[~each.success]
        pairs = held[:, None] - failed[None]
        return float(((pairs > 0) + 0.5 * (pairs == 0)).mean())

    assert auroc(("a", "b"), 3) > auroc(("a", "b"), 1) + 0.1
    assert auroc(("a",), 3) > 0.7


@pytest.mark.slow
def test_instances_with_fewer_views_are_left_out_and_counted(
    given: Training, single: PrincipalForecasts
) -> None:
    """In scene 1 the camera stands still, and in scene 2 there are two sides alone."""
    poses = {key: pose for key, pose in given.motion.world_T_cam.items() if key[0] > 2}
    poses |= {(1, image): CAMERAS[0] for image in range(len(CAMERAS))}
    poses |= {(2, image): CAMERAS[image] for image in (0, 1)}
    inputs = Inputs({}, {"d": given.results})
    rules = {"max_views": 3, "views_from": "all"}
    views = fuse_principals(inputs, {"d": CameraMotion(poses)}, [given.data], **rules)["a"]
    found = view_forecasts(given.data, views, single, models=given.models, **FAST)
    assert found.without_views == 2 * 2 * len(CAMERAS)
    scenes = {name.split("/")[-1] for name in found.forecasts[("a", "b"), 3].scenes.tolist()}
    assert len(scenes) == 10


def test_views_that_contradict_each_other_leave_no_forecast_by_one_estimator(
    given: Training, views: PrincipalViews, single: PrincipalForecasts
) -> None:
    def contradicting(number: int) -> Any:
        found = views.alone.test[number]
        left = found.data.views.copy()
        left[found.data.row == 7] = 1
        return replace(found, data=replace(found.data, views=left))

    alone = replace(views.alone, test={v: contradicting(v) for v in (2, 3)})
    together = replace(views.together, test={v: views.together.test[v] for v in (2, 3)})
    left = together.test[2].data.views.copy()
    left[together.test[2].data.row == 7] = 1
    data = replace(together.test[2].data, views=left)
    together = replace(
        together, test={2: replace(together.test[2], data=data), 3: together.test[3]}
    )
    changed = PrincipalViews(together, alone)
    found = view_forecasts(given.data, changed, single, models=given.models, **FAST)
    assert found.forecasts[("a",), 2].probability[7] == 0.0
    assert found.contradicted[2] >= 1
    everyone = ("a", "b")
    assert_allclose(
        found.forecasts[everyone, 2].probability[7], found.forecasts[everyone, 1].probability[7]
    )


@pytest.mark.slow
def test_one_view_and_too_many_are_refused(given: Training, single: PrincipalForecasts) -> None:
    inputs = Inputs({}, {"d": given.results})
    motions = {"d": given.motion}
    with pytest.raises(InputError, match="with 1 view at most there is nothing to compare"):
        fuse_principals(inputs, motions, [given.data], max_views=1)
    views = fuse_principals(inputs, motions, [given.data], max_views=6, views_from="all")["a"]
    with pytest.raises(InputError, match="no instance of a with forecasts has 6 views"):
        view_forecasts(given.data, views, single, models=given.models, **FAST)


@pytest.mark.slow
def test_a_dataset_without_camera_poses_is_left_out(given: Training) -> None:
    """Scenes 7 to 12 are another dataset, of whose camera nothing is known."""
    estimates = given.data.estimates
    second = estimates.scene_id > 6
    dataset = np.where(second, "e", "d")
    data = replace(given.data, estimates=with_keys(estimates, dataset=dataset))
    first = {name: table.select(table.scene_id <= 6) for name, table in given.results.items()}
    other = {name: table.select(table.scene_id > 6) for name, table in given.results.items()}
    inputs = Inputs({}, {"d": first, "e": other})
    motion = {key: pose for key, pose in given.motion.world_T_cam.items() if key[0] <= 6}
    rules = {"max_views": 2, "views_from": "all"}
    views = fuse_principals(inputs, {"d": CameraMotion(motion)}, [data], **rules)["a"]
    models = dict.fromkeys("de", given.models["d"])
    single = forecast_principals([data], models=models, **FAST)[0]
    found = view_forecasts(data, views, single, models=models, **FAST)
    assert found.without_views == second.sum()
    for forecast in found.forecasts.values():
        assert {name.split("-")[0] for name in forecast.objects.tolist()} == {"d"}
