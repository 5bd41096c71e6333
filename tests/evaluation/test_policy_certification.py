"""Certificates of policies, against literally running the policy at each threshold."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
import pytest

from graspcast import Certificate, Forecaster
from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results
from graspcast.errors import MismatchError
from graspcast.estimates.instances import unit_names
from graspcast.estimates.loading import Inputs
from graspcast.evaluation.certification import GuaranteeOptions, certify_trials
from graspcast.evaluation.policy_certification import certify_policy, policy_trials
from graspcast.evaluation.threshold_trials import trials_of_looks
from graspcast.forecasting.fallbacks import Fallbacks
from graspcast.forecasting.looking import run_at_once, run_policy
from graspcast.forecasting.recorded_looks import looks_with_views, verdicts_with_views
from graspcast.forecasting.recorded_verdicts import ViewSettings
from graspcast.forecasting.verdict import VerdictRow
from graspcast.guarantees.certify import certify
from graspcast.guarantees.threshold_sequence import ThresholdSequence
from graspcast.views.camera_motion import CameraMotion
from looked_at import CAMERAS, NAMES, joined, trained
from static_scenes import estimates_of, objects, scattered, seen

# Forests are trained, and a policy is run at every threshold.
pytestmark = pytest.mark.slow

SCENES = range(101, 113)
SETTINGS = ViewSettings(guide="fused", max_looks=3, views_from="all")
ASKED = GuaranteeOptions(rate=0.6, confidence=0.8, unit="image", ood_alpha=0.0)


@dataclass
class World:
    forecaster: Forecaster
    dataset: BopDataset
    results: dict[str, Results]
    motions: dict[str, CameraMotion]
    outcomes: pl.DataFrame

    def inputs(self) -> Inputs:
        return Inputs({"d": self.dataset}, {"d": self.results})

    def certify(self, settings: ViewSettings = SETTINGS, **more: Any) -> Certificate:
        options = replace(ASKED, **more)
        given = self.inputs(), self.motions, settings, self.outcomes, options
        return certify_policy(self.forecaster, *given)

    def success(self, row: VerdictRow) -> bool:
        key = {"scene_id": row.key.scene_id, "im_id": row.key.im_id, "obj_id": row.key.obj_id}
        found = self.outcomes.filter(estimator=row.principal, est_id=row.key.est_id, **key)
        assert len(found) == 1
        return bool(found["success"].item())


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    """New scenes, with outcomes of all guides: an error of 8 mm or less succeeds."""
    folder = tmp_path_factory.mktemp("views") / "d"
    with pytest.warns(match="not calibrated"):
        forecaster, _ = trained(folder / "models")
    truth, tables = {}, {name: [] for name in NAMES}
    for scene in SCENES:
        truth[scene] = seen(CAMERAS, objects(2, scene))
        for k, name in enumerate(NAMES):
            found = scattered(truth[scene], 10 * scene + k)
            tables[name].append(estimates_of(found, scene_id=scene))
    keys = [(s, i) for s in SCENES for i in range(len(CAMERAS))]
    scenes, images = zip(*keys, strict=True)
    motion = CameraMotion.of(scenes, images, np.concatenate([CAMERAS] * len(SCENES)))
    results = {name: joined(some) for name, some in tables.items()}
    given = World(forecaster, BopDataset(folder), results, {"d": motion}, pl.DataFrame())
    rows: dict[tuple[Any, ...], int] = {}
    for settings in (SETTINGS, replace(SETTINGS, guide="best"), replace(SETTINGS, guide="b")):
        run = run_policy(forecaster, given.inputs(), "d", motion, settings, threshold=1.0)
        once = replace(settings, max_looks=1)
        runs = (*run.stages, run_at_once(forecaster, given.inputs(), "d", motion, once).rows)
        for row in (row for stage in runs for row in stage):
            key = row.key
            off = row.cam_T_obj[:3, 3] - truth[key.scene_id][key.im_id, key.obj_id - 1, :3, 3]
            rows[(row.principal, *key, row.gripper)] = int(np.linalg.norm(off) < 0.008)
    names = ["estimator", "dataset", "scene_id", "im_id", "obj_id", "est_id", "gripper", "success"]
    table = [(*key, held) for key, held in rows.items()]
    return replace(given, outcomes=pl.DataFrame(table, schema=names, orient="row"))


@pytest.mark.slow
@pytest.mark.parametrize("guide", ["fused", "best", "b"])
def test_counts_are_those_of_running_the_policy_at_each_threshold(world: World, guide: str) -> None:
    settings = replace(SETTINGS, guide=guide)
    motion = world.motions["d"]
    given = world.forecaster, world.inputs(), "d", motion, settings
    trials, untried = policy_trials(*given, world.outcomes, ASKED)
    assert untried == 0 and len(trials.instances) == 2 * len(CAMERAS) * len(SCENES)
    counts = []
    asked = np.nanquantile(trials.probability, [0.1, 0.3, 0.6, 0.9]).tolist()
    for threshold in (0.0, *asked, 1.0):
        run = run_policy(*given, threshold=threshold, ood_alpha=0.0)
        attempts = [row for row in run.rows if row.verdict.attempt]
        sequence = ThresholdSequence((threshold,), (1.0,), "the test")
        found = certify_trials(world.forecaster.card, trials, ASKED, 0, sequence=sequence).overall
        held = sum(map(world.success, attempts))
        assert (found.attempts, found.successful_attempts) == (len(attempts), held)
        counts.append((len(attempts), held, int(run.looks.sum())))
    # The policy is not the same at all thresholds, and takes further looks at some.
    assert len(set(counts)) > 4
    assert len({looks for *_, looks in counts}) > 3


@pytest.mark.slow
@pytest.mark.parametrize("most", [0.7, 1.0])
def test_a_table_of_thresholds_counts_what_the_policy_does_at_each(
    world: World, most: float
) -> None:
    given = world.forecaster, world.inputs(), "d", world.motions["d"], SETTINGS
    trials = trials_of_looks(run_policy(*given, threshold=most, ood_alpha=0.0).each, world.outcomes)
    seen = set()
    for threshold in (0.0, 0.3, 0.5, 0.65, 0.7, 0.8, 1.0):
        if threshold > most:
            continue
        run = run_policy(*given, threshold=threshold, ood_alpha=0.0)
        attempts = [row for row in run.rows if row.verdict.attempt]
        attempted, success, looks = trials.at(threshold)
        assert attempted.sum() == len(attempts)
        assert success.sum() == sum(map(world.success, attempts))
        assert looks.tolist() == run.looks.tolist()
        seen.add((len(attempts), int(looks.sum())))
    assert len(seen) > 3


@pytest.mark.slow
def test_alternatives_are_what_would_have_been_certified(world: World) -> None:
    certificate = world.certify(per_object=True, simultaneous=True)
    names = {other.name: other for other in certificate.alternatives}
    assert list(names) == [
        "all images weighted equally",
        "scenes as units",
        "one look",
        "at most 2 looks",
    ]
    assert (names["scenes as units"].unit, names["scenes as units"].units) == ("scene", len(SCENES))
    motion = world.motions["d"]
    trials, _ = policy_trials(
        world.forecaster, world.inputs(), "d", motion, SETTINGS, world.outcomes, ASKED
    )
    for name, looks in (("one look", 1), ("at most 2 looks", 2)):
        found = certify(
            trials.probability[:, :looks],
            trials.success[:, :looks],
            unit_names(trials.instances, "image"),
            rate=0.6,
            confidence=certificate.overall.confidence,
        ).overall
        mine = names[name]
        assert (mine.threshold, mine.best) == (found.threshold, found.best)
        assert mine.possible_confidence == found.possible_confidence


def test_the_certificate_states_its_policy_and_predict_keeps_it(world: World) -> None:
    certificate = world.certify()
    overall = certificate.overall
    assert overall.threshold is not None and overall.lower_bound >= 0.6
    assert certificate.provenance["guides"] == ["a", "fused", "fused2", "fused3"]
    assert certificate.sequence.source == "no data"
    assert certificate.policy is not None and certificate.policy.max_looks == 3
    given = Fallbacks([world.forecaster]), world.inputs(), world.motions
    how = {"certificates": [certificate], "ood_alpha": 0.0}
    rows = verdicts_with_views(*given, SETTINGS, **how)
    assert sum(row.verdict.attempt for row in rows) == overall.attempts
    held = sum(world.success(row) for row in rows if row.verdict.attempt)
    assert held == overall.successful_attempts
    assert {row.verdict.guarantee for row in rows if row.verdict.attempt} == {str(overall)}
    looks = looks_with_views(*given, SETTINGS, **how)
    assert [each.last.verdict for each in looks] == [row.verdict for row in rows]
    for other, message in (
        (replace(SETTINGS, guide="best"), "guide is fused, not best"),
        (replace(SETTINGS, views_from="earlier"), "views_from is all, not earlier"),
        (replace(SETTINGS, max_looks=1), "max_looks is 3, not 1"),
    ):
        with pytest.raises(MismatchError, match=message):
            verdicts_with_views(*given, other, **how)
    with pytest.raises(MismatchError, match="but the verdicts are of one view"):
        given[0].verdict_rows(world.inputs(), **how)
    with pytest.raises(MismatchError, match="certificate is of one view, guided by the principal"):
        single = replace(certificate, policy=None)
        verdicts_with_views(*given, SETTINGS, certificates=[single], ood_alpha=0.0)


@pytest.mark.parametrize("guide", ["fused", "best"])
def test_several_views_without_looking_again(world: World, guide: str) -> None:
    settings = replace(SETTINGS, guide=guide, max_looks=1)
    certificate = world.certify(settings, per_object=True, sequence_share=0.3)
    assert "not used for certification" in certificate.sequence.source
    assert [g.scope for g in certificate.guarantees] == ["all objects", "d-1", "d-2"]
    assert "fused" in certificate.provenance["guides"]
    given = Fallbacks([world.forecaster]), world.inputs(), world.motions, settings
    rows = verdicts_with_views(*given, certificates=[certificate], ood_alpha=0.0)
    kept = certificate.overall.trials
    assert kept < len(rows)
    assert (certificate.overall.threshold is None) == (not any(r.verdict.attempt for r in rows))


def test_of_one_view_it_is_the_principals(world: World) -> None:
    options = world.inputs(), {}, ViewSettings(), world.outcomes, ASKED
    certificate = certify_policy(world.forecaster, *options)
    assert certificate.policy is None and "guides" not in certificate.provenance


@pytest.mark.slow
def test_missing_outcomes_are_named(world: World) -> None:
    some = world.outcomes.filter(pl.col("estimator") != "fused3")
    given = world.inputs(), world.motions, SETTINGS
    with pytest.raises(
        MismatchError, match=r"no outcomes of fused3 on d .*up to 3 views"
    ) as caught:
        certify_policy(world.forecaster, *given, some, ASKED)
    assert caught.value.parameters == ("outcomes",)
    few = world.outcomes.filter(pl.col("scene_id") < SCENES[8])
    certificate = certify_policy(world.forecaster, *given, few, ASKED)
    assert certificate.overall.trials == 8 * 2 * len(CAMERAS)
    assert any("left out 40 instances that lack an outcome" in text for text in given[0].notes)
    other = world.outcomes.with_columns(scene_id=pl.col("scene_id") + 1000)
    with pytest.raises(MismatchError, match="no instance has an outcome of every grasp"):
        certify_policy(world.forecaster, *given, other, ASKED)


def test_datasets_with_and_without_camera_poses_are_not_mixed(world: World) -> None:
    inputs = Inputs({"d": world.dataset}, {"d": world.results, "e": world.results})
    with pytest.raises(MismatchError, match="camera poses of d, but not of e"):
        certify_policy(world.forecaster, inputs, world.motions, SETTINGS, world.outcomes, ASKED)
