"""train and predict with forests: simulation, attribution, certificates, fallbacks, novelty."""

from __future__ import annotations

import csv
import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import synthetic
from commands import refused
from graspcast.bop.results import Results, write_results
from graspcast.bop.units import millimetres
from graspcast.cli import main
from graspcast.estimates.outcomes import ERROR_COLUMNS, error_numbers
from graspcast.forecasting.forecaster import Forecaster
from graspcast.guarantees.certificate import Certificate
from poses import results_of, write_models

N, SCENES, UNUSUAL = 120, 6, 7


def tables() -> dict[str, Results]:
    given = synthetic.training_data(N, scenes=SCENES).estimates
    return {
        name: dataclasses.replace(
            results_of(given.of(name)), scene_id=given.scene_id, obj_id=given.obj_id
        )
        for name in given.estimators
    }


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Estimates, truths and outcomes of two objects, a simulated campaign, and three models."""
    root = tmp_path_factory.mktemp("world")
    write_models(root / "made" / "models", obj_1={}, obj_2={})
    given = synthetic.training_data(N, scenes=SCENES)
    estimates = given.estimates
    for scene in range(SCENES):
        folder = root / "made" / "test" / f"{scene:06d}"
        folder.mkdir(parents=True)
        images = {
            str(i): [
                {
                    "obj_id": int(estimates.obj_id[i]),
                    "cam_R_m2c": given.truth[i, :3, :3].ravel().tolist(),
                    "cam_t_m2c": millimetres(given.truth[i, :3, 3]).tolist(),
                }
            ]
            for i in np.flatnonzero(estimates.scene_id == scene).tolist()
        }
        (folder / "scene_gt.json").write_text(json.dumps(images))
    for name, table in tables().items():
        write_results(root / f"{name}_made-test.csv", table)
    keys = {
        "dataset": ["made"] * N,
        "scene_id": estimates.scene_id,
        "im_id": estimates.im_id,
        "obj_id": estimates.obj_id,
    }
    outcomes = [
        pl.DataFrame(keys | {"success": held.astype(int)}).with_columns(
            estimator=pl.lit(name), gripper=pl.lit("parallel")
        )
        for name, held in zip(estimates.estimators, given.success, strict=True)
    ]
    pl.concat(outcomes).write_csv(root / "outcomes.csv")
    pl.concat(outcomes).filter(obj_id=1).write_csv(root / "first.csv")
    trials = synthetic.error_outcomes(300, "made-2")
    errors = zip(ERROR_COLUMNS, error_numbers(trials.obj_T_est).T, strict=True)
    columns = {
        "estimator": ["transferred"] * 300,
        "dataset": ["made"] * 300,
        "scene_id": [0] * 300,
        "im_id": list(range(300)),
        "obj_id": [2] * 300,
        "gripper": ["parallel"] * 300,
        "success": trials.success.astype(int),
    }
    (root / "campaign").mkdir()
    pl.DataFrame(columns | dict(errors)).write_parquet(root / "campaign" / "outcomes.parquet")
    with_outcomes = ["--outcomes", str(root / "outcomes.csv")]
    assert main(train(root, "abc.npz", *with_outcomes)) == 0
    assert main(train(root, "ab.npz", *with_outcomes, names="ab")) == 0
    assert main(train(root, "simulated.npz", "--simulated", str(root / "campaign"))) == 0
    return root


def inputs(world: Path, names: str = "abc", folder: Path | None = None) -> list[str]:
    out = ["--bop", str(world / "made")]
    for name in names:
        out += ["--estimates", f"{name}={(folder or world) / f'{name}_made-test.csv'}"]
    return out


def train(world: Path, out: str, *more: str, names: str = "abc") -> list[str]:
    start = ["train", *inputs(world, names), "--principal", "a", "--gripper", "parallel"]
    folds = [] if "--folds" in more or "--outcomes" not in more else ["--folds", "0"]
    return [*start, "--trees", "16", "--out", str(world / out), *folds, *more]


def predict(
    world: Path,
    out: Path,
    *more: str,
    models: tuple[str, ...] = ("abc.npz",),
    names: str = "abc",
    folder: Path | None = None,
) -> list[str]:
    start = ["predict", *inputs(world, names, folder), "--out", str(out / "v.csv")]
    return [*start, *(t for m in models for t in ("--model", str(world / m))), *more]


def verdicts(out: Path) -> list[dict[str, str]]:
    with (out / "v.csv").open() as stream:
        return list(csv.DictReader(stream))


def test_an_object_known_by_simulated_trials_alone(
    world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    card = Forecaster.load(world / "simulated.npz").card
    assert (card.objects, card.simulated, card.samples) == (("made-2",), ("made-2",), 0)
    said = refused(predict(world, tmp_path, models=("simulated.npz",)), capsys)
    assert "was not trained for made-1; it knows made-2" in said
    only = ("--objects", "2", "--ood-alpha", "0")
    assert main(predict(world, tmp_path, *only, models=("simulated.npz",))) == 0
    truth = {
        (row["im_id"], row["obj_id"]): row["success"]
        for row in pl.read_csv(world / "outcomes.csv").filter(estimator="a").iter_rows(named=True)
    }
    rows = verdicts(tmp_path)
    assert {row["obj_id"] for row in rows} == {"2"}
    right = [(row["verdict"] == "attempt") == (truth[int(row["im_id"]), 2] == 1) for row in rows]
    assert np.mean(right) > 0.7


def test_simulated_trials_beside_outcomes_of_another_object(
    world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    more = ["--outcomes", str(world / "first.csv"), "--simulated", str(world / "campaign")]
    assert main(train(world, "both.npz", *more)) == 0
    assert "2 objects (1 by simulation alone), 60 samples" in capsys.readouterr().out


def test_nothing_to_learn_from(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(train(world, "none.npz"), capsys)
    assert "neither outcomes nor simulated trials" in said
    assert "(see --outcomes, --simulated)" in said
    other = train(world, "none.npz", "--simulated", str(world / "campaign"), "--gripper", "hand")
    assert "no simulated trial of the hand gripper" in refused(other, capsys)
    without = train(world, "none.npz", "--simulated", str(world / "outcomes.csv"))
    assert "no column 'error_x_m'" in refused(without, capsys)
    assert not (world / "none.npz").exists()


@pytest.mark.parametrize("method", ["blend", "two-stage"])
def test_a_method_that_needs_ground_truth_is_refused_without_it(
    world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], method: str
) -> None:
    outcomes = ["--outcomes", str(world / "outcomes.csv")]
    command = [*train(world, "none.npz", *outcomes), "--method", method]
    bare = tmp_path / "made"
    shutil.copytree(world / "made" / "models", bare / "models")
    command[command.index("--bop") + 1] = str(bare)
    said = refused(command, capsys)
    assert f"the method {method} needs ground truth" in said
    assert "choose the method direct" in said
    assert "(see --ground-truth, --bop, --method)" in said
    assert not (world / "none.npz").exists()
    elsewhere = tmp_path / "elsewhere" / "000000"
    elsewhere.mkdir(parents=True)
    (elsewhere / "scene_gt.json").write_text(
        json.dumps(
            {
                "9999": [
                    {
                        "obj_id": 1,
                        "cam_R_m2c": [1, 0, 0, 0, 1, 0, 0, 0, 1],
                        "cam_t_m2c": [0, 0, 900],
                    }
                ]
            }
        )
    )
    said = refused([*command, "--ground-truth", str(elsewhere.parent)], capsys)
    assert "none of the instances has a known true pose" in said
    assert main([*command, "--method", "direct", "--out", str(tmp_path / "direct.npz")]) == 0


def test_explanations_are_those_of_the_forecaster(world: Path, tmp_path: Path) -> None:
    assert main(predict(world, tmp_path)) == 0
    plain = verdicts(tmp_path)
    assert main(predict(world, tmp_path, "--explain")) == 0
    for row, before in zip(verdicts(tmp_path), plain, strict=True):
        assert row["probability"] == before["probability"]
        assert row["reason"].startswith(before["reason"] + "; attributed to ")
        told = row["reason"].rpartition("; attributed to ")[2].split(", ")
        assert len(told) == 2
        sizes = [abs(float(each.rpartition(" ")[2])) for each in told]
        assert sizes[0] >= sizes[1]
        assert all(each.startswith(("rotation by", "position by", "b against c")) for each in told)


def guaranteed(world: Path, tmp_path: Path, model: str, names: str, threshold: float) -> Path:
    """A promise for a model (certified here on its training scenes, which promises nothing)."""
    path = tmp_path / f"{model}.json"
    arguments = ["certify", *inputs(world, names), "--model", str(world / f"{model}.npz")]
    arguments += ["--outcomes", str(world / "outcomes.csv"), "--unit", "image"]
    arguments += ["--allow-training-scenes", "--rate", str(threshold), "--out", str(path)]
    assert main(arguments) == 0
    return path


def test_a_promise_brings_the_threshold_and_belongs_to_its_model(
    world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = guaranteed(world, tmp_path, "abc", "abc", 0.7)
    guarantee = Certificate.load(path).overall
    assert guarantee.threshold is not None
    capsys.readouterr()
    assert main(predict(world, tmp_path, "--certificate", str(path))) == 0
    assert str(guarantee) in capsys.readouterr().out
    for row in verdicts(tmp_path):
        likely = float(row["probability"]) >= guarantee.threshold
        assert (row["verdict"] == "attempt") == (
            likely and "out-of-distribution" not in row["reason"]
        )
    again = tmp_path / "again"
    both = ("--certificate", str(path), "--threshold", "0.4")
    assert "leave out --threshold" in refused(predict(world, again, *both), capsys)
    mismatched = predict(world, again, "--certificate", str(path), models=("ab.npz",))
    assert "no certificate was made for the model with b: certify it" in refused(mismatched, capsys)
    two = predict(world, again, "--certificate", str(path), models=("abc.npz", "ab.npz"))
    assert "no certificate was made for the model with b" in refused(two, capsys)
    assert not again.exists()


def test_where_nothing_could_be_certified_nothing_is_attempted(world: Path, tmp_path: Path) -> None:
    path = guaranteed(world, tmp_path, "abc", "abc", 0.9999)
    assert Certificate.load(path).overall.threshold is None
    assert main(predict(world, tmp_path, "--certificate", str(path))) == 0
    for row in verdicts(tmp_path):
        assert row["verdict"] == "abstain"
        assert "no threshold could be certified" in row["reason"]


def test_a_second_model_stands_in_where_a_supporter_is_missing(
    world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = tables()
    for name, table in given.items():
        kept = np.full(N, True)
        if name == "c":
            kept[10:30] = False
        if name == "b":
            kept[25:40] = False
        write_results(tmp_path / f"{name}_made-test.csv", table.select(kept))
    each = {}
    for model, names in (("abc.npz", "abc"), ("ab.npz", "ab")):
        assert main(predict(world, tmp_path, models=(model,), names=names, folder=tmp_path)) == 0
        each[model] = {int(row["im_id"]): row for row in verdicts(tmp_path)}
    both = ("ab.npz", "abc.npz")
    assert main(predict(world, tmp_path, models=both, folder=tmp_path)) == 0
    rows = {int(row["im_id"]): row for row in verdicts(tmp_path)}
    assert sorted(rows) == list(range(N))
    for i, row in rows.items():
        if 25 <= i < 40:
            assert (row["verdict"], row["probability"]) == ("abstain", "")
            continue
        model, supporters = ("ab.npz", "b") if 10 <= i < 30 else ("abc.npz", "b, c")
        assert row["probability"] == each[model][i]["probability"]
        assert row["reason"].endswith(f"; with {supporters}")
    said = refused(predict(world, tmp_path, models=both, names="ac", folder=tmp_path), capsys)
    assert "there are no estimates by b for the model with 2" in said


def test_strange_disagreement_is_abstained_from_unless_it_is_trusted(
    world: Path, tmp_path: Path
) -> None:
    for name, table in tables().items():
        poses = table.cam_T_obj.copy()
        if name == "b":
            poses[UNUSUAL, :3, 3] += [3.0, -2.0, 4.0]
        write_results(
            tmp_path / f"{name}_made-test.csv", dataclasses.replace(table, cam_T_obj=poses)
        )
    found = {}
    for share in ("0", "0.01", "1"):
        more = ("--ood-alpha", share, "--threshold", "0")
        assert main(predict(world, tmp_path, *more, folder=tmp_path)) == 0
        found[share] = {int(row["im_id"]): row for row in verdicts(tmp_path)}
    assert {row["verdict"] for row in found["0"].values()} == {"attempt"}
    assert {row["verdict"] for row in found["1"].values()} == {"abstain"}
    unusual = found["0.01"][UNUSUAL]
    assert unusual["verdict"] == "abstain"
    assert "out-of-distribution disagreement (p-value 0.008" in unusual["reason"]
    assert unusual["probability"] == found["0"][UNUSUAL]["probability"]
    assert sum(row["verdict"] == "abstain" for row in found["0.01"].values()) <= 4
