"""Verdicts with several views."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from graspcast.bop.models import Models
from graspcast.bop.results import Results
from graspcast.errors import MismatchError, UnknownNameError
from graspcast.forecasting.contradictions import CONTRADICTED, MOVED
from graspcast.forecasting.forecaster import Forecaster
from graspcast.pose.transforms import compose, invert
from graspcast.views.camera_motion import CameraMotion
from graspcast.views.fused_estimates import FusedEstimates
from looked_at import CAMERAS, NAMES, fused, trained
from static_scenes import estimates_of, motion_of, objects, scattered, seen

POSES = seen(CAMERAS, objects(2, 500))


@dataclass
class World:
    forecaster: Forecaster
    without: Forecaster
    models: dict[str, Models]
    results: dict[str, Results]
    motion: CameraMotion

    def fused(self, most: int = 3, **other: Results) -> FusedEstimates:
        return fused(self.results | other, self.models, self.motion, most)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    with pytest.warns(match="not calibrated"):
        forecaster, models = trained(tmp_path_factory.mktemp("views"))
        without, _ = trained(tmp_path_factory.mktemp("none"), views=False)
    tables = {n: estimates_of(scattered(POSES, 700 + k)) for k, n in enumerate(NAMES)}
    return World(forecaster, without, models, tables, motion_of(CAMERAS))


def test_one_model_answers_for_every_guide_and_number_of_views(world: World) -> None:
    for most in (1, 2, 3, 5):
        some = world.fused(most)
        for guide in (None, "b", "fused", "best"):
            rows = world.forecaster.judge(some, world.models, guide=guide)
            assert len(rows) == len(some)
            for i, row in enumerate(rows):
                assert row.views == some.views[i] and row.verdict.probability is not None
                said = "one view" if row.views == 1 else f"{row.views} views"
                assert said in row.verdict.reason
                name = {None: "a", "b": "b", "fused": "fused"}.get(guide)
                name = "a" if name == "fused" and row.views == 1 else name
                assert name in (None, row.principal)
                if row.principal == "fused":
                    np.testing.assert_array_equal(row.cam_T_obj, some.poses.cam_T_obj[i])


def test_from_one_view_it_says_what_the_single_view_model_says(world: World) -> None:
    some = world.fused(1)
    rows = world.forecaster.judge(some, world.models, threshold=0.7)
    from graspcast.estimates.alignment import align

    estimates = align(world.results, dataset="d", anchor="a")
    alone = world.forecaster.verdicts(estimates, world.models, threshold=0.7)
    for row, verdict in zip(rows, alone, strict=True):
        assert row.verdict.probability == pytest.approx(verdict.probability, abs=1e-12)
        assert row.verdict.attempt == verdict.attempt


def test_best_is_never_less_probable_than_any_guide(world: World) -> None:
    some = world.fused(3)
    by = {
        guide: [
            r.verdict.probability for r in world.forecaster.judge(some, world.models, guide=guide)
        ]
        for guide in ("a", "b", "c", "fused", "best")
    }
    top = np.max([by[name] for name in ("a", "b", "c", "fused")], axis=0)
    np.testing.assert_allclose(by["best"], top)
    assert np.mean(by["fused"]) > np.mean(by["a"]) + 0.1


def test_it_looks_again_only_where_that_pays_and_looks_are_left(world: World) -> None:
    judge = world.forecaster.judge
    for most, limit in ((1, 3), (2, 3), (3, 3), (1, 1)):
        some = world.fused(most)
        rows = judge(some, world.models, guide="fused", threshold=0.7, max_looks=limit)
        for row in rows:
            if row.verdict.look is not None:
                assert str(row.verdict) == "look again" and not row.verdict.attempt
                assert row.views < limit
                expected, now = row.verdict.look.expected_probability, row.verdict.probability
                assert expected is not None and now is not None and expected >= now + 0.02
        if most == 1:
            assert any(row.verdict.look for row in rows) == (limit > 1)
    dear = judge(world.fused(1), world.models, threshold=0.7, max_looks=3, min_gain=0.99)
    assert not any(row.verdict.look for row in dear)
    assert any("does not pay" in row.verdict.reason for row in dear)
    world_frame = judge(
        world.fused(1), world.models, threshold=1.0, max_looks=2, motion=world.motion
    )
    for i, row in enumerate(world_frame):
        look = row.verdict.look
        if look is not None and look.direction_world is not None:
            cam = world.motion.world_T_cam[row.key.scene_id, row.key.im_id]
            np.testing.assert_allclose(look.direction_world, cam[:3, :3] @ look.direction)
            assert i >= 0


def test_an_object_that_was_moved_before_the_judged_image_is_not_attempted(world: World) -> None:
    moved = POSES.copy()
    last = len(CAMERAS) - 1
    there = np.eye(4)
    there[:3, 3] = 0.08
    moved[last, 0] = compose(
        compose(invert(CAMERAS[last]), there), compose(CAMERAS[last], moved[last, 0])
    )
    tables = {n: estimates_of(scattered(moved, 800 + k)) for k, n in enumerate(NAMES)}
    some = fused(tables, world.models, world.motion, 4)
    rows = world.forecaster.judge(some, world.models, guide="fused", threshold=0.0)
    mine = [r for r in rows if (r.key.im_id, r.key.obj_id) == (last, 1)]
    assert not mine[0].verdict.attempt and MOVED in mine[0].verdict.reason


def test_of_two_views_that_contradict_each_other_none_is_attempted(world: World) -> None:
    apart = POSES.copy()
    apart[1, 0, 0, 3] += 0.1
    tables = {n: estimates_of(scattered(apart, 800 + k)) for k, n in enumerate(NAMES)}
    pair = {n: t.select((t.im_id < 2) & (t.obj_id == 1)) for n, t in tables.items()}
    some = fused(pair, world.models, world.motion)
    assert some.views.tolist() == [1, 1]
    for forecaster in (world.forecaster, world.without):
        for guide in ("a", "fused", "best"):
            for row in forecaster.judge(some, world.models, guide=guide, threshold=0.0):
                assert not row.verdict.attempt and row.verdict.probability is None
                assert row.verdict.reason == f"{CONTRADICTED}; one view"
    again = world.forecaster.judge(some, world.models, threshold=0.0, max_looks=3)
    assert all(row.verdict.look is not None for row in again)
    assert all("no third decides" in row.verdict.reason for row in again)
    # A third view that agrees with one of them decides.
    three = {n: t.select((t.im_id < 3) & (t.obj_id == 1)) for n, t in tables.items()}
    rows = world.forecaster.judge(fused(three, world.models, world.motion), world.models)
    said = {row.key.im_id: row for row in rows}
    assert MOVED in said[1].verdict.reason
    assert said[0].verdict.probability is not None and said[0].views == 2


def test_what_was_not_trained_so_is_refused_or_said(world: World) -> None:
    some = world.fused(3)
    with pytest.raises(UnknownNameError, match="unknown guide 'z'"):
        world.forecaster.judge(some, world.models, guide="z")
    two = fused({n: world.results[n] for n in "ab"}, world.models, world.motion)
    with pytest.raises(MismatchError, match="fused from a, b, but this model was trained with"):
        world.forecaster.judge(two, world.models)
    # A model without views judges each image alone, and says so.
    rows = world.without.judge(some, world.models)
    assert all("one view" in row.verdict.reason for row in rows)


def test_a_missing_estimate_is_no_obstacle_with_several_views(world: World) -> None:
    c = world.results["c"]
    some = world.fused(3, c=c.select(c.im_id != 4))
    rows = world.forecaster.judge(some, world.models)
    mine = [r for r in rows if r.key.im_id == 4]
    assert mine and all(r.verdict.probability is not None and r.views > 1 for r in mine)
    alone = world.forecaster.judge(world.fused(1, c=c.select(c.im_id != 4)), world.models)
    said = {r.verdict.reason for r in alone if r.key.im_id == 4}
    assert said == {"no estimate by c; one view"}


def test_an_object_that_nobody_knows_stops_no_verdict_on_others(world: World) -> None:
    poses = seen(CAMERAS, objects(3, 500))  # object 3 is neither in training nor in the models
    tables = {n: estimates_of(scattered(poses, 700 + k)) for k, n in enumerate(NAMES)}
    for guide in ("fused", "best", "b"):
        rows = world.forecaster.judge(
            fused(tables, world.models, world.motion, 3), world.models, guide=guide, max_looks=3
        )
        said = {row.verdict.reason for row in rows if row.key.obj_id == 3}
        assert said and all(
            reason.startswith("the model was not trained for d-3") for reason in said
        )
        others = [row.verdict.probability for row in rows if row.key.obj_id < 3]
        assert others and None not in others
