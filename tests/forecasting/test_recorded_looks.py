"""Verdicts on recorded estimates with camera poses."""

from __future__ import annotations

from dataclasses import replace

import pytest

from graspcast.bop.dataset import BopDataset
from graspcast.errors import MismatchError
from graspcast.estimates.loading import Inputs
from graspcast.forecasting.fallbacks import Fallbacks
from graspcast.forecasting.recorded_looks import verdicts_with_views
from graspcast.forecasting.recorded_verdicts import ViewSettings
from looked_at import trained, training


def test_every_instance_of_the_guide_gets_a_verdict_by_the_views_there_are(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    root = tmp_path_factory.mktemp("given") / "d"
    given = training(root / "models")
    with pytest.warns(match="not calibrated"):
        forecaster, _ = trained(tmp_path_factory.mktemp("views"))
        without, _ = trained(tmp_path_factory.mktemp("none"), views=False)
    inputs = Inputs({"d": BopDataset(root)}, {"d": given.results})
    motions = {"d": given.motion}
    settings = ViewSettings(views_from="all", guide="fused")
    with_views = verdicts_with_views(Fallbacks([forecaster]), inputs, motions, settings)
    assert len(with_views) == len(given.data)
    assert [row.key for row in with_views] == sorted(row.key for row in with_views)
    assert {row.views for row in with_views} == {3}
    alone = verdicts_with_views(Fallbacks([forecaster]), inputs, {}, settings)
    assert {row.views for row in alone} == {1}
    earlier = replace(settings, views_from="earlier")
    some = verdicts_with_views(Fallbacks([forecaster]), inputs, motions, earlier)
    assert {row.views for row in some if row.key.im_id == 0} == {1}
    with pytest.raises(MismatchError, match="trained without views"):
        verdicts_with_views(Fallbacks([without]), inputs, motions, settings)


def test_no_further_model_answers_for_an_object_that_moved(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    root = tmp_path_factory.mktemp("given") / "d"
    given = training(root / "models")
    with pytest.warns(match="not calibrated"):
        forecaster, _ = trained(tmp_path_factory.mktemp("views"))
        fewer, _ = trained(tmp_path_factory.mktemp("none"), views=False, names="ab")
    results = {}
    for name, rows in given.results.items():
        poses = rows.cam_T_obj.copy()
        here = (rows.scene_id == rows.scene_id[0]) & (rows.im_id == rows.im_id[0])
        poses[here, 0, 3] += 0.15
        results[name] = replace(rows, cam_T_obj=poses)
    inputs = Inputs({"d": BopDataset(root)}, {"d": results})
    rows = verdicts_with_views(
        Fallbacks([forecaster, fewer]),
        inputs,
        {"d": given.motion},
        ViewSettings(views_from="all", guide="fused"),
        threshold=0.0,
    )
    moved = [row for row in rows if "the object was moved" in row.verdict.reason]
    assert moved
    assert not any(row.verdict.attempt for row in moved)
