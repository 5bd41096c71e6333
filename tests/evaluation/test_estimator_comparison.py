"""Comparing principals and supporters in a world in which it is known who is worth what."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import synthetic
from graspcast import (
    Comparison,
    Estimates,
    ForestSettings,
    Models,
    TrainingData,
    compare,
    score,
)
from graspcast.bop.results import write_results
from graspcast.cli import main
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.instances import Instances
from graspcast.evaluation.cross_validation import cross_validate, cross_validated
from graspcast.evaluation.paired_differences import FORECAST, STANDING
from graspcast.forecasting import train
from poses import nudged, random_poses, results_of, write_models

FORESTS = ForestSettings(trees=16, draws=16, folds=0)
FAST: dict[str, Any] = {"folds": 3, "bootstrap": 100, "forests": FORESTS}


@dataclasses.dataclass(frozen=True)
class World:
    """``a`` is right half of the time and ``b`` nine times in ten; every other is pure noise."""

    n: int
    names: str
    truth: np.ndarray
    poses: dict[str, np.ndarray]
    scene: np.ndarray
    outcomes: pl.DataFrame

    @classmethod
    def make(
        cls, n: int = 240, names: str = "abc", *, scenes: int = 12, tried: str = "ab"
    ) -> World:
        truth = random_poses(n)
        rng = np.random.default_rng(5)
        scene = np.arange(n) * scenes // n
        poses, rows = {}, []
        for k, name in enumerate(names):
            right = rng.random(n) < {"a": 0.5, "b": 0.9}.get(name, 0.0)
            near = nudged(truth, 10 + k, metres=0.002, radians=0.02)
            off = nudged(truth, 20 + k, metres=0.04, radians=0.4)
            noise = random_poses(n, 30 + k)
            poses[name] = np.where(right[:, None, None], near, off if name in "ab" else noise)
            if name in tried:
                out_of_fold = np.linalg.norm(poses[name][:, :3, 3] - truth[:, :3, 3], axis=-1)
                rows += [
                    (
                        name,
                        "made",
                        int(scene[i]),
                        i,
                        1 + i % 2,
                        "parallel",
                        int(out_of_fold[i] < 0.02),
                        0,
                    )
                    for i in range(n)
                ]
        columns = ["estimator", "dataset", "scene_id", "im_id", "obj_id", "gripper", "success"]
        outcomes = pl.DataFrame(rows, schema=[*columns, "est_id"], orient="row").with_columns(
            grasp=pl.lit("reference")
        )
        return cls(n, names, truth, poses, scene, outcomes)

    @property
    def estimates(self) -> Estimates:
        return Estimates(
            estimators=tuple(self.names),
            instances=Instances(
                dataset=np.full(self.n, "made"),
                scene_id=self.scene,
                im_id=np.arange(self.n),
                obj_id=1 + np.arange(self.n) % 2,
                est_id=np.zeros(self.n, np.int64),
            ),
            cam_T_obj=np.stack(list(self.poses.values())),
        )

    def training_data(self, principal: str) -> TrainingData:
        return TrainingData.join(
            self.estimates, self.outcomes, principal, "parallel", truth=self.truth
        )


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Models]:
    folder = write_models(tmp_path_factory.mktemp("models"), obj_1={}, obj_2={})
    return {"made": Models(folder)}


@pytest.fixture(scope="module")
def found(models: dict[str, Models]) -> Comparison:
    world = World.make()
    return compare([world.training_data("a"), world.training_data("b")], models=models, **FAST)


# --- Worth ----------------------------------------------------------------------------------------


def test_a_supporter_that_knows_is_worth_much_and_noise_nothing(found: Comparison) -> None:
    judged = found.principals["a"]
    informative, noise = judged.without["b"].gain, judged.without["c"].gain
    assert informative["auroc"].low > 0.2
    assert informative["aurc"].low > 0.1
    assert informative["success_at_50"].low > 0.1
    assert not noise["aurc"].distinct
    assert abs(noise["aurc"].value) < 0.02
    assert abs(noise["auroc"].value) < 0.05
    # It suffices alone, and noise alone does not.
    assert not judged.alone["b"].gain["aurc"].distinct
    assert judged.alone["c"].gain["aurc"].low > 0.1
    assert (
        "worth having: b (+"
        in dataclasses.replace(found, standings={"a": found.standings["a"]}).recommendation
    )


def test_the_principal_that_is_right_more_often_is_recommended(found: Comparison) -> None:
    assert found.ranking == ("b", "a")
    assert found.ahead["b", "a"]["success"].low > 0.2
    assert found.ahead["b", "a"]["aurc"].distinct
    assert found.recommendation.startswith("Take b as principal: over all attempt rates alike 0.9")
    assert "may be chance" not in found.recommendation
    assert "from zero beside the others: " in found.recommendation


def test_paired_differences_are_antisymmetric(found: Comparison, models: dict[str, Models]) -> None:
    for measure in STANDING:
        one, other = found.ahead["a", "b"][measure], found.ahead["b", "a"][measure]
        assert_allclose((one.value, one.low, one.high), (-other.value, -other.high, -other.low))
        better = -1 if measure == "aurc" else 1
        out_of_fold = found.standings["a"][measure] - found.standings["b"][measure]
        assert one.value == pytest.approx(better * out_of_fold)


@pytest.mark.slow
def test_the_order_of_principals_does_not_matter(
    found: Comparison, models: dict[str, Models]
) -> None:
    world = World.make()
    turned = compare([world.training_data("b"), world.training_data("a")], models=models, **FAST)
    assert turned.ahead == found.ahead


def test_a_lesser_principal_is_named_where_it_is_ahead(found: Comparison) -> None:
    def said(rates: tuple[float, ...]) -> str:
        standings = {name: dict(figures) for name, figures in found.standings.items()}
        standings["a"] |= dict(zip(STANDING[1:], rates, strict=True))
        return dataclasses.replace(found, standings=standings).recommendation

    assert "hold more often" not in said((0.1, 0.1, 0.1, 0.1))
    assert "a's hold more often at 90 / 100 % (0.990 / 0.980)" in said((0.1, 0.1, 0.99, 0.98))


def test_figures_are_those_of_forecasts_without_the_supporter(
    found: Comparison, models: dict[str, Models]
) -> None:
    world = World.make()
    judged = found.principals["a"]
    success = world.training_data("a").tried().own_success == 1
    values = {}
    for names in ("abc", "ab"):
        # As if the third had never been there.
        given = dataclasses.replace(world, poses={n: world.poses[n] for n in names}, names=names)
        p = cross_validated(given.training_data("a"), models=models, folds=3, forests=FORESTS)
        values[names] = score(p, success, np.zeros(len(p)))
    for name in FORECAST:
        assert judged.figures[name] == pytest.approx(getattr(values["abc"], name))
        assert judged.without["c"].figures[name] == pytest.approx(getattr(values["ab"], name))
    gain = values["ab"].aurc - values["abc"].aurc
    assert judged.without["c"].gain["aurc"].value == pytest.approx(gain)
    assert (judged.n, judged.unjudged, judged.scenes) == (240, 0, 12)


# --- Any number of estimators ---------------------------------------------------------------------


@pytest.mark.parametrize("names", ["ab", "abc", "abcd", "abcde", "abcdef"])
def test_two_to_six_estimators(names: str, models: dict[str, Models]) -> None:
    world = World.make(60, names, scenes=6, tried="a")
    heard: list[float] = []
    options = {**FAST, "folds": 2, "bootstrap": 5}
    options["forests"] = ForestSettings(trees=4, draws=4, folds=0)
    found = compare([world.training_data("a")], models=models, progress=heard.append, **options)
    judged = found.principals["a"]
    supporters = list(names[1:]) if len(names) > 2 else []
    assert list(judged.without) == list(judged.alone) == supporters
    assert heard == sorted(heard)
    assert heard[-1] == pytest.approx(1)
    assert "no other principal has outcomes" in found.recommendation
    if names == "ab":
        assert "b is its only supporter, without which there is no forecast" in found.recommendation
    if names == "abc":  # one without the other is it alone
        assert judged.without["b"] == judged.alone["c"]
    json.dumps(found.as_dict(), allow_nan=False)


def test_principals_that_share_no_instance_are_not_ranked(models: dict[str, Models]) -> None:
    world = World.make(120, scenes=6)
    early = (pl.col("estimator") == "a") & (pl.col("scene_id") < 3)
    late = (pl.col("estimator") == "b") & (pl.col("scene_id") >= 3)
    out_of_fold = dataclasses.replace(world, outcomes=world.outcomes.filter(early | late))
    options = {**FAST, "folds": 2, "bootstrap": 5}
    found = compare(
        [out_of_fold.training_data("a"), out_of_fold.training_data("b")], models=models, **options
    )
    assert found.common == 0
    assert found.ranking == ()
    assert "no instance was tried with all of a, b" in found.recommendation
    json.dumps(found.as_dict(), allow_nan=False)


# --- Cross-validated probabilities ----------------------------------------------------------------


def test_blocks_of_frames_are_cut_as_in_training(
    monkeypatch: pytest.MonkeyPatch, models: dict[str, Models]
) -> None:
    """Of one scene's 100 frames 60 were tried: none is judged by its own block of 20 frames."""
    world = World.make(100, scenes=1)
    tried = dataclasses.replace(world, outcomes=world.outcomes.filter(pl.col("im_id") < 60))
    judged: list[int] = []

    def spy(kept: TrainingData, **options: Any) -> Any:
        forecaster = training_of(kept, **options)
        seen = set((kept.estimates.im_id // 20).tolist())

        def probability(estimates: Estimates, *more: Any, **named: Any) -> np.ndarray:
            assert not seen & set((estimates.im_id // 20).tolist())
            judged.extend(estimates.im_id.tolist())
            return forecaster.probability(estimates, *more, **named)

        return SimpleNamespace(card=forecaster.card, probability=probability)

    training_of = train.train_forecaster
    monkeypatch.setattr("graspcast.evaluation.cross_validation.train_forecaster", spy)
    given = tried.training_data("a")
    probability = cross_validated(given, folds=3, method="threshold", models=models)
    assert sorted(judged) == list(range(60))
    assert not np.isnan(probability).any()
    found = cross_validate(given, folds=3, method="threshold", models=models)
    assert found == score(probability, given.tried().own_success == 1, given.tried().objects)


def test_an_object_of_one_scene_has_no_probability(models: dict[str, Models]) -> None:
    world = World.make(120, scenes=6)
    given = world.training_data("a")
    alone = synthetic.with_keys(
        given.estimates, obj_id=np.where(given.estimates.scene_id == 2, 2, 1)
    )
    given = dataclasses.replace(given, estimates=alone)
    probability = cross_validated(given, folds=3, method="threshold", models=models)
    assert_array_equal(np.isnan(probability), alone.scene_id == 2)


# --- Mistakes -------------------------------------------------------------------------------------


def test_what_cannot_be_compared_is_refused(models: dict[str, Models]) -> None:
    world = World.make(60, scenes=6)
    a, b = world.training_data("a"), world.training_data("b")
    with pytest.raises(InputError, match="0 principals"):
        compare([])
    with pytest.raises(InputError, match="1 folds"):
        compare([a], folds=1)
    with pytest.raises(MismatchError, match="of a twice"):
        compare([a, a])
    with pytest.raises(MismatchError, match="of b of a, b, c and the other gripper"):
        compare([a, dataclasses.replace(b, gripper="other")])
    with pytest.raises(MismatchError, match="of b of a, b and the parallel gripper"):
        compare([a, b.only("a", "b")])
    with pytest.raises(MismatchError, match="6 scenes cannot make 7 folds"):
        compare([a], models=models, folds=7)
    with pytest.raises(MismatchError, match="a is the principal, but not among b, c"):
        a.only("b", "c")


# --- The verb -------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    world = World.make(72, scenes=6)
    write_models(tmp_path / "made" / "models", obj_1={}, obj_2={})
    for name, poses in world.poses.items():
        table = results_of(poses)
        table = dataclasses.replace(table, scene_id=world.scene, obj_id=1 + np.arange(72) % 2)
        write_results(tmp_path / f"{name}_made-test.csv", table)
    world.outcomes.write_csv(tmp_path / "outcomes.csv")
    return tmp_path


def arguments(folder: Path, *more: str, names: str = "abc", gripper: str = "parallel") -> list[str]:
    out = ["compare", "--bop", str(folder / "made"), "--gripper", gripper]
    for name in names:
        out += ["--estimates", f"{name}={folder / f'{name}_made-test.csv'}"]
    out += ["--outcomes", str(folder / "outcomes.csv"), "--trees", "4", "--folds", "2"]
    return [*out, "--bootstrap", "20", *more]


def test_the_verb_prints_what_it_writes(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = folder / "compare.json"
    assert main(arguments(folder, "--json", str(path))) == 0
    out, err = capsys.readouterr()
    assert "the direct forest alone, since two stages need truth" in err
    assert "no instance has an outcome of c" in err
    figures = json.loads(path.read_text())["compare"]
    keys = ["gripper", "estimators", "principals", "common", "recommendation", "settings"]
    assert list(figures) == keys
    assert set(figures["principals"]) == {"a", "b"}
    judged = figures["principals"]["a"]
    assert set(judged) == {
        "n", "unjudged", "scenes", "success", "figures", "without", "alone",
    }  # fmt: skip
    assert set(judged["figures"]) == set(FORECAST)
    gain = judged["without"]["b"]["gain"]["aurc"]
    assert set(gain) == {"value", "low", "high"}
    assert f"{gain['value']:+.3f} [{gain['low']:+.3f}, {gain['high']:+.3f}]" in out
    assert f"{judged['success']:.3f} hold if all are attempted" in out
    assert figures["common"]["n"] == 72
    assert set(figures["common"]["ahead"]["a"]["b"]) == set(STANDING)
    assert figures["recommendation"] in out
    assert figures["settings"]["forests"]["trees"] == 4


def test_two_estimators_are_told_what_cannot_be_said(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments(folder, names="ab")) == 0
    out, _ = capsys.readouterr()
    assert "is its only supporter, without which there is no forecast" in out
    assert "without a" not in out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"names": "a"}, "a consensus takes at least two estimators"),
        ({"gripper": "vacuum"}, "unknown gripper 'vacuum'; known: parallel. These have"),
        ({"names": "bc", "more": ["--folds", "1"]}, "two folds"),
        ({"more": ["--folds", "9"]}, "6 scenes cannot make 9 folds"),
    ],
)
def test_mistakes_are_said_in_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], options: dict[str, Any], message: str
) -> None:
    path = folder / "never.json"
    more = [*options.pop("more", []), "--json", str(path)]
    assert main(arguments(folder, *more, **options)) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert not path.exists()
    last = err.strip().splitlines()[-1]
    assert last.startswith("graspcast compare: ")
    assert re.search(message, last), last
