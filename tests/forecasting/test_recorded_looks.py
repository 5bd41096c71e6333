"""Verdicts on recorded estimates with camera poses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from graspcast import Forecaster
from graspcast.bop.dataset import BopDataset
from graspcast.errors import MismatchError
from graspcast.estimates.loading import Inputs
from graspcast.forecasting.fallbacks import Fallbacks
from graspcast.forecasting.recorded_looks import looks_with_views, verdicts_with_views
from graspcast.forecasting.recorded_verdicts import ViewSettings
from looked_at import Training, trained, training


@dataclass(frozen=True)
class World:
    root: Path
    given: Training
    forecaster: Forecaster


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    root = tmp_path_factory.mktemp("given") / "d"
    given = training(root / "models")
    with pytest.warns(match="not calibrated"):
        forecaster, _ = trained(tmp_path_factory.mktemp("views"))
    return World(root, given, forecaster)


def test_every_instance_of_the_guide_gets_a_verdict_by_the_views_there_are(
    world: World, tmp_path: Path
) -> None:
    root, given, forecaster = world.root, world.given, world.forecaster
    with pytest.warns(match="not calibrated"):
        without, _ = trained(tmp_path, views=False)
    inputs = Inputs({"d": BopDataset(root)}, {"d": given.results})
    motions = {"d": given.motion}
    settings = ViewSettings(views_from="all", guide="fused")
    shares: list[float] = []
    with_views = verdicts_with_views(
        Fallbacks([forecaster]),
        inputs,
        motions,
        settings,
        progress=lambda share, _: shares.append(share),
    )
    assert shares[0] == 0.0 and shares == sorted(shares) and 0.3 < shares[-1] < 1.0
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


def test_no_further_model_answers_for_an_object_that_moved(world: World, tmp_path: Path) -> None:
    root, given, forecaster = world.root, world.given, world.forecaster
    with pytest.warns(match="not calibrated"):
        fewer, _ = trained(tmp_path, views=False, names="ab")
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


@pytest.mark.slow
def test_what_the_principal_lacks_is_judged_by_the_views_of_others(
    world: World,
) -> None:
    root, given, forecaster = world.root, world.given, world.forecaster
    a = given.results["a"]
    here = (a.scene_id == 1) & (a.im_id == 2)
    settings = ViewSettings(views_from="all", guide="fused")
    for kept, images in ((~here, {2}), (a.scene_id > 1, {0, 1, 2, 3, 4}), (a.scene_id < 0, None)):
        inputs = Inputs({"d": BopDataset(root)}, {"d": given.results | {"a": a.select(kept)}})
        asked = Fallbacks([forecaster]), inputs, {"d": given.motion}
        rows = verdicts_with_views(*asked, settings, threshold=0.0)
        assert len(rows) == len(given.data)
        assert {(row.views, row.principal) for row in rows} == {(3, "fused")}
        assert any(row.verdict.attempt for row in rows)
        if images is None:
            continue
        said = [text for text in inputs.notes if "lacks" in text]
        assert said == [f"judged {2 * len(images)} instances that a lacks and b has"]
        # From one view there is no forecast without the principal.
        looks = looks_with_views(*asked, replace(settings, max_looks=2), threshold=0.9)
        mine = [x for x in looks if x.rows[0].key.scene_id == 1 and x.rows[0].key.im_id in images]
        assert len(mine) == 2 * len(images)
        for each in mine:
            assert "no estimate by a; one view" in each.rows[0].verdict.reason
            assert each.rows[0].principal == "b" and each.rows[1].principal == "fused2"
        # Another guide than the fused pose has its own instances alone.
        own = verdicts_with_views(*asked, replace(settings, guide=None))
        assert len(own) == int(kept.sum())
