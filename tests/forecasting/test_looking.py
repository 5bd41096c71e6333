"""The look-again policy on recorded data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from graspcast import Forecaster
from graspcast.bop.dataset import BopDataset
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.loading import Inputs
from graspcast.forecasting.looking import PolicyRun, ended_stages, run_at_once, run_policy
from graspcast.forecasting.recorded_verdicts import ViewSettings, fused_of
from looked_at import CAMERAS, NAMES, trained
from static_scenes import estimates_of, motion_of, objects, scattered, seen

POSES = seen(CAMERAS, objects(2, 77))
INPUTS = {"d": {name: estimates_of(scattered(POSES, 900 + k)) for k, name in enumerate(NAMES)}}
MOTION = motion_of(CAMERAS)


@dataclass
class World:
    forecaster: Forecaster
    dataset: BopDataset
    without_views: Forecaster

    def inputs(self) -> Inputs:
        return Inputs({"d": self.dataset}, INPUTS)

    def run(self, threshold: float | None, **settings: Any) -> PolicyRun:
        given: dict[str, Any] = {"views_from": "all", "max_looks": 3, "guide": "fused"} | settings
        return run_policy(
            self.forecaster,
            self.inputs(),
            "d",
            MOTION,
            ViewSettings(**given),
            threshold=threshold,
            ood_alpha=0.0,
        )


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    with pytest.warns(match="not calibrated"):
        folder = tmp_path_factory.mktemp("views") / "d"
        forecaster, _ = trained(folder / "models")
        without, _ = trained(tmp_path_factory.mktemp("none"), views=False)
    return World(forecaster, BopDataset(folder), without)


def test_at_threshold_0_all_are_attempted_after_one_look_or_novel(world: World) -> None:
    run = world.run(0.0)
    first = [row.verdict for row in run.stages[0]]
    usual = [i for i, verdict in enumerate(first) if not verdict.out_of_distribution]
    assert len(usual) > len(first) / 2
    assert all(run.rows[i].verdict.attempt and run.looks[i] == 1 for i in usual)


def test_at_threshold_1_none_is_attempted_that_is_not_certain(world: World) -> None:
    for row in world.run(1.0).rows:
        assert row.verdict.attempt == (row.verdict.probability == 1.0)


def test_one_look_is_the_verdict_of_a_single_image(world: World) -> None:
    settings = ViewSettings(guide="a", views_from="all")
    run = world.run(0.7, guide="a", max_looks=1)
    (fused,) = fused_of(world.forecaster, world.inputs(), "d", None, settings)
    judged = world.forecaster.judge(
        fused, world.inputs().models, guide="a", threshold=0.7, ood_alpha=0.0
    )
    assert [row.verdict for row in run.rows] == [row.verdict for row in judged]
    assert [row.key for row in run.rows] == [row.key for row in judged]
    assert run.looks.tolist() == [1] * len(judged)


def test_it_takes_further_looks_only_where_the_verdict_asks_for_them(world: World) -> None:
    run = world.run(0.7)
    assert len(set(run.looks.tolist())) > 1
    for i, (row, looks) in enumerate(zip(run.rows, run.looks.tolist(), strict=True)):
        assert all(run.stages[s][i].verdict.look is not None for s in range(looks - 1))
        assert row is run.stages[looks - 1][i]
        assert row.verdict.look is None
    assert f"{int((run.looks == 1).sum())} after 1" in repr(run)


def test_a_fused_guide_is_named_by_the_looks_allowed(world: World) -> None:
    run = world.run(0.7)
    assert {row.principal for row in run.stages[1]} == {"fused2"}
    assert {row.principal for row in run.stages[2]} == {"fused3"}
    names = {"a", "b", "c"}
    assert {row.principal for row in run.stages[0]} <= names


def test_where_recorded_views_end_the_verdict_stays_look_again(world: World) -> None:
    run = world.run(1.0, views_from="earlier", min_gain=-1.0)
    first = [i for i, row in enumerate(run.rows) if row.key.im_id == 0]
    assert first
    for i in first:
        assert (str(run.rows[i].verdict), run.looks[i]) == ("look again", 1)


def test_what_it_lacks_is_named(world: World) -> None:
    inputs, settings = world.inputs(), ViewSettings(max_looks=2)
    with pytest.raises(MismatchError, match="trained with views"):
        run_policy(world.without_views, inputs, "d", MOTION, settings)
    with pytest.raises(MismatchError, match="need camera poses"):
        run_policy(world.forecaster, inputs, "d", None, settings)
    with pytest.raises(InputError, match="1 or more, not 0"):
        run_policy(world.forecaster, inputs, "d", MOTION, ViewSettings(max_looks=0))


def test_the_looks_of_a_stage_hold_those_of_the_stage_before(world: World) -> None:
    given = [
        fused_of(
            world.forecaster,
            world.inputs(),
            "d",
            MOTION,
            ViewSettings(views_from="all", max_views=most),
        )[0].gathered.present.any(axis=2)
        for most in (1, 2, 3)
    ]
    assert [int(present.sum(axis=1).max()) for present in given] == [1, 2, 3]
    np.testing.assert_array_equal(given[1], given[2][:, :2])


def test_a_run_at_threshold_1_holds_the_forecasts_of_the_policy_at_any_threshold(
    world: World,
) -> None:
    probability = world.run(1.0).probability
    asked = np.nanquantile(probability, [0.05, 0.2, 0.5, 0.8]).tolist()
    taken = set()
    for threshold in (0.0, *asked, 1.0):
        run = world.run(threshold)
        reached = probability >= threshold
        attempts = np.array([row.verdict.attempt for row in run.rows])
        np.testing.assert_array_equal(attempts, reached.any(axis=1))
        np.testing.assert_array_equal(run.looks[attempts], reached.argmax(axis=1)[attempts] + 1)
        last = (run.looks - 1)[attempts]
        at = probability[attempts, last]
        said = [row.verdict.probability for row in run.rows if row.verdict.attempt]
        assert at.tolist() == said
        taken.add(int(run.looks.sum()))
    assert len(taken) > 2


def test_each_instance_has_a_verdict_for_every_image_there_was(world: World) -> None:
    run = world.run(0.7, views_from="earlier")
    assert [len(each.rows) for each in run.each] == run.images.tolist()
    assert set(run.images.tolist()) == {1, 2, 3}
    for i, each in enumerate(run.each):
        assert each.last is run.rows[i] and each.ended == run.looks[i]
        assert all(row is run.stages[s][i] for s, row in enumerate(each.rows))


def test_all_views_at_once_are_a_run_of_one_stage(world: World) -> None:
    settings = ViewSettings(views_from="all", guide="fused", max_views=2)
    given = world.forecaster, world.inputs(), "d", MOTION, settings
    run = run_at_once(*given, threshold=0.7)
    assert {row.views for row in run.rows} == {2} and len(run.stages) == 1
    assert {row.principal for row in run.rows} == {"fused"}
    assert set(run.looks.tolist()) == {1}
    assert run.probability.shape == (len(run.rows), 1)


def test_looking_ends_where_it_does_not_go_on() -> None:
    goes_on = np.array([[1, 0, 1, 1], [0, 1, 1, 0]], dtype=bool)
    assert ended_stages(goes_on).tolist() == [1, 0, 2, 1]
    assert ended_stages(np.empty((0, 3), dtype=bool)).tolist() == [0, 0, 0]
