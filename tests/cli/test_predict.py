"""The verb predict: verdicts, certificates, fallbacks, attribution, novelty."""

from __future__ import annotations

import csv
import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import forest_commands as forests
import graspcast
from commands import refused
from graspcast.bop.results import write_results
from graspcast.cli import main
from graspcast.forecasting.forecaster import Forecaster
from graspcast.guarantees.certificate import Certificate
from network_commands import N, predict, train, write_made
from poses import random_poses, results_of


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of ``world``, and a model of them."""
    folder = write_made(tmp_path_factory.mktemp("taught"))
    assert main(train(folder, "--folds", "0")) == 0
    return folder


@pytest.fixture
def taught(once: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(once, tmp_path, dirs_exist_ok=True))


@pytest.mark.slow
def test_from_estimates_to_verdicts(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(train(world, "--folds", "3", "--json", str(world / "card.json"))) == 0
    out, _ = capsys.readouterr()
    assert "unseen scenes" in out
    assert "a with b, c, parallel gripper, 1 object, 60 samples" in out
    card = json.loads((world / "card.json").read_text())["card"]
    assert card["scores"]["unseen_scenes"]["n"] == 60
    assert card["versions"]["graspcast"] == graspcast.__version__
    assert main(predict(world, "--threshold", "0.4")) == 0
    assert "60 verdicts" in capsys.readouterr().out
    with (world / "v.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert (rows[0]["dataset"], rows[0]["est_id"], rows[0]["grasp"]) == ("made", "0", "reference")
    assert {(row["principal"], row["gripper"]) for row in rows} == {("a", "parallel")}
    for row in rows:
        assert (row["verdict"] == "attempt") is (float(row["probability"]) >= 0.4)


def test_verdicts_in_python_are_those_of_the_command(taught: Path) -> None:
    assert main(predict(taught)) == 0
    forecaster = graspcast.Forecaster.load(taught / "m.npz")
    tables = {n: graspcast.read_results(taught / f"{n}_made-test.csv") for n in "abc"}
    models = {"made": graspcast.BopDataset(taught / "made").models}
    with (taught / "v.csv").open() as stream:
        written = {int(r["im_id"]): float(r["probability"]) for r in csv.DictReader(stream)}
    for i in (0, 17, 59):
        poses = {name: table.cam_T_obj[i] for name, table in tables.items()}
        verdict = forecaster.predict(poses, "made-1", models=models)
        assert verdict.probability == pytest.approx(written[i], abs=1e-5)


def test_where_a_supporter_found_nothing_the_verdict_is_to_abstain(
    taught: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = taught / "b_made-test.csv"
    lines = path.read_text().splitlines()
    fields = lines[1].split(",")
    fields[4:6] = ["1 0 0 0 1 0 0 0 1", "0 0 0"]
    path.write_text("\n".join([lines[0], ",".join(fields), *lines[3:]]) + "\n")
    capsys.readouterr()
    assert main(predict(taught)) == 0
    err = capsys.readouterr().err
    assert "dropped 1 rows (placeholder)" in err
    assert "dropped instances without an estimate: 2 by b" in err
    with (taught / "v.csv").open() as stream:
        rows = {int(r["im_id"]): r for r in csv.DictReader(stream)}
    assert len(rows) == N
    for image in (0, 1):
        assert rows[image]["verdict"] == "abstain"
        assert rows[image]["probability"] == ""
        assert rows[image]["reason"] == "no estimate by b"


def test_models_of_other_estimators_or_objects(
    taught: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(predict(taught, names="ab"), capsys)
    assert "there are no estimates by c for the model with 2 supporters; given: a, b" in said
    for seed, name in enumerate("abc"):
        path = taught / f"{name}_made-test.csv"
        write_results(path, results_of(random_poses(5, seed), obj_id=2))
    said = refused(predict(taught), capsys)
    assert "this model was not trained for made-2; it knows made-1" in said
    assert not (taught / "v.csv").exists()


def test_truncated_models(taught: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = taught / "m.npz"
    path.write_bytes(path.read_bytes()[:-40])
    assert "m.npz: is not a complete npz file" in refused(predict(taught), capsys)
    path.unlink()
    assert "No such file" in refused(predict(taught), capsys)


@pytest.mark.slow
def test_an_object_known_by_simulated_trials_alone(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    card = Forecaster.load(trained / "simulated.npz").card
    assert (card.objects, card.simulated, card.samples) == (("made-2",), ("made-2",), 0)
    only = ("--objects", "1")
    said = refused(forests.predict(trained, tmp_path, *only, models=("simulated.npz",)), capsys)
    assert "was not trained for made-1; it knows made-2" in said
    only = ("--objects", "2", "--ood-alpha", "0")
    assert main(forests.predict(trained, tmp_path, *only, models=("simulated.npz",))) == 0
    truth = {
        (row["im_id"], row["obj_id"]): row["success"]
        for row in pl.read_csv(trained / "outcomes.csv").filter(estimator="a").iter_rows(named=True)
    }
    rows = forests.verdicts(tmp_path)
    assert {row["obj_id"] for row in rows} == {"2"}
    right = [(row["verdict"] == "attempt") == (truth[int(row["im_id"]), 2] == 1) for row in rows]
    assert np.mean(right) > 0.7


def test_explanations_are_those_of_the_forecaster(trained: Path, tmp_path: Path) -> None:
    assert main(forests.predict(trained, tmp_path)) == 0
    plain = forests.verdicts(tmp_path)
    assert main(forests.predict(trained, tmp_path, "--explain")) == 0
    for row, before in zip(forests.verdicts(tmp_path), plain, strict=True):
        assert row["probability"] == before["probability"]
        assert row["reason"].startswith(before["reason"] + "; attributed to ")
        told = row["reason"].rpartition("; attributed to ")[2].split(", ")
        assert len(told) == 2
        sizes = [abs(float(each.rpartition(" ")[2])) for each in told]
        assert sizes[0] >= sizes[1]
        assert all(each.startswith(("rotation by", "position by", "b against c")) for each in told)


def guaranteed(trained: Path, tmp_path: Path, model: str, names: str, threshold: float) -> Path:
    """A promise for a model (certified here on its training scenes, which promises nothing)."""
    path = tmp_path / f"{model}.json"
    arguments = [
        "certify",
        *forests.inputs(trained, names),
        "--model",
        str(trained / f"{model}.npz"),
    ]
    arguments += ["--outcomes", str(trained / "outcomes.csv"), "--unit", "image"]
    arguments += ["--allow-training-scenes", "--rate", str(threshold), "--out", str(path)]
    assert main(arguments) == 0
    return path


def test_a_promise_brings_the_threshold_and_belongs_to_its_model(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = guaranteed(trained, tmp_path, "abc", "abc", 0.7)
    guarantee = Certificate.load(path).overall
    assert guarantee.threshold is not None
    capsys.readouterr()
    assert main(forests.predict(trained, tmp_path, "--certificate", str(path))) == 0
    assert str(guarantee) in capsys.readouterr().out
    for row in forests.verdicts(tmp_path):
        likely = float(row["probability"]) >= guarantee.threshold
        assert (row["verdict"] == "attempt") == (
            likely and "out-of-distribution" not in row["reason"]
        )
    again = tmp_path / "again"
    both = ("--certificate", str(path), "--threshold", "0.4")
    assert "leave out --threshold" in refused(forests.predict(trained, again, *both), capsys)
    mismatched = forests.predict(trained, again, "--certificate", str(path), models=("ab.npz",))
    assert "no certificate was made for the model with b: certify it" in refused(mismatched, capsys)
    two = forests.predict(trained, again, "--certificate", str(path), models=("abc.npz", "ab.npz"))
    assert "no certificate was made for the model with b" in refused(two, capsys)
    assert not again.exists()


def test_where_nothing_could_be_certified_nothing_is_attempted(
    trained: Path, tmp_path: Path
) -> None:
    path = guaranteed(trained, tmp_path, "abc", "abc", 0.9999)
    assert Certificate.load(path).overall.threshold is None
    assert main(forests.predict(trained, tmp_path, "--certificate", str(path))) == 0
    for row in forests.verdicts(tmp_path):
        assert row["verdict"] == "abstain"
        assert "no threshold could be certified" in row["reason"]


def test_a_second_model_stands_in_where_a_supporter_is_missing(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = forests.tables()
    for name, table in given.items():
        kept = np.full(forests.N, True)
        if name == "c":
            kept[10:30] = False
        if name == "b":
            kept[25:40] = False
        write_results(tmp_path / f"{name}_made-test.csv", table.select(kept))
    each = {}
    for model, names in (("abc.npz", "abc"), ("ab.npz", "ab")):
        assert (
            main(forests.predict(trained, tmp_path, models=(model,), names=names, folder=tmp_path))
            == 0
        )
        each[model] = {int(row["im_id"]): row for row in forests.verdicts(tmp_path)}
    both = ("ab.npz", "abc.npz")
    assert main(forests.predict(trained, tmp_path, models=both, folder=tmp_path)) == 0
    rows = {int(row["im_id"]): row for row in forests.verdicts(tmp_path)}
    assert sorted(rows) == list(range(forests.N))
    for i, row in rows.items():
        if 25 <= i < 40:
            assert (row["verdict"], row["probability"]) == ("abstain", "")
            continue
        model, supporters = ("ab.npz", "b") if 10 <= i < 30 else ("abc.npz", "b, c")
        assert row["probability"] == each[model][i]["probability"]
        assert row["reason"].endswith(f"; with {supporters}")
    said = refused(
        forests.predict(trained, tmp_path, models=both, names="ac", folder=tmp_path), capsys
    )
    assert "there are no estimates by b for the model with 2" in said


def test_disagreement_larger_than_in_training_is_always_abstained_from(
    trained: Path, tmp_path: Path
) -> None:
    for name, table in forests.tables().items():
        poses = table.cam_T_obj.copy()
        if name == "b":
            poses[forests.UNUSUAL, :3, 3] += [3.0, -2.0, 4.0]
        write_results(
            tmp_path / f"{name}_made-test.csv", dataclasses.replace(table, cam_T_obj=poses)
        )
    found = {}
    for share in ("0", "0.01", "1"):
        more = ("--ood-alpha", share, "--threshold", "0")
        assert main(forests.predict(trained, tmp_path, *more, folder=tmp_path)) == 0
        found[share] = {int(row["im_id"]): row for row in forests.verdicts(tmp_path)}
    assert {row["verdict"] for row in found["1"].values()} == {"abstain"}
    for share in ("0", "0.01"):
        unusual = found[share].pop(forests.UNUSUAL)
        assert unusual["verdict"] == "abstain"
        said = unusual["reason"]
        assert "out-of-distribution disagreement (b is " in said, said
        assert "object diameters from a; the limit is " in said, said
        assert unusual["probability"]
    for row in found["0"].values():
        assert (row["verdict"] == "attempt") != ("out-of-distribution" in row["reason"])
    assert found["0.01"].keys() == found["0"].keys()
    p_values = [row for row in found["0.01"].values() if "(p-value" in row["reason"]]
    assert len(p_values) <= 4


@pytest.mark.slow
def test_objects_not_in_training_stop_no_verdict_on_the_others(
    trained: Path, tmp_path: Path
) -> None:
    first = ("--outcomes", str(trained / "first.csv"))
    assert main(forests.train(trained, "one.npz", *first)) == 0
    assert main(forests.predict(trained, tmp_path, models=("one.npz",))) == 0
    assert {row["obj_id"] for row in forests.verdicts(tmp_path)} == {"1", "2"}
    for row in forests.verdicts(tmp_path):
        if row["obj_id"] == "1":
            assert row["probability"]
        else:
            assert not row["probability"] and row["verdict"] == "abstain"
            assert row["reason"] == "the model was not trained for made-2"


@pytest.mark.slow
def test_objects_without_a_model_stop_no_verdict_on_the_others(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = sorted(trained.glob("?_made-test.csv"))
    texts = [path.read_text() for path in paths]
    assert main(forests.predict(trained, tmp_path)) == 0
    before = forests.verdicts(tmp_path)
    try:
        for path, text in zip(paths, texts, strict=True):
            row = next(line for line in text.splitlines()[1:] if line.split(",")[2] == "1")
            scene, image, _, rest = row.split(",", 3)
            path.write_text(f"{text}{scene},{image},9,{rest}\n")
        assert main(forests.predict(trained, tmp_path)) == 0
        assert "dropped 1 rows (object without a model: 9)" in capsys.readouterr().err
        assert forests.verdicts(tmp_path) == before
        first = ("--outcomes", str(trained / "first.csv"))
        assert main(forests.train(trained, "nine.npz", *first)) == 0
    finally:
        for path, text in zip(paths, texts, strict=True):
            path.write_text(text)


@pytest.mark.slow
def test_a_model_of_few_outcomes_of_one_scene_warns_when_trained_and_when_used(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = ["--scenes", "1", "--outcomes", str(trained / "outcomes.csv"), "--folds", "0"]
    assert main([*forests.train(trained, "few.npz"), *scene]) == 0
    out, told = capsys.readouterr()
    assert "in 1 scene, one look, each grasp forecast without its block of frames" in out
    for said in (told, predicted(trained, tmp_path, "few.npz", capsys)):
        assert "Warning: trained on one scene: nothing is known about" in said
        assert "smallest novelty p-value of 0.0" in said
    for row in forests.verdicts(tmp_path):
        if row["probability"]:
            unknown = "novelty not checkable at level 0.01 (smallest p-value" in row["reason"]
            assert unknown != ("out-of-distribution" in row["reason"])


def predicted(trained: Path, tmp_path: Path, model: str, capsys: pytest.CaptureFixture[str]) -> str:
    assert main(forests.predict(trained, tmp_path, models=(model,))) == 0
    return capsys.readouterr().err


@pytest.fixture(scope="module")
def two_grasps(trained: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Outcomes of two grasps, of which the second holds where the first does not; and a model."""
    folder = tmp_path_factory.mktemp("two_grasps")
    first = pl.read_csv(trained / "outcomes.csv").with_columns(grasp=pl.lit("reference"))
    second = first.with_columns(grasp=pl.lit("top"), success=1 - pl.col("success"))
    pl.concat([first, second]).write_csv(folder / "several.csv")
    given = ["--outcomes", str(folder / "several.csv"), "--folds", "0"]
    command = forests.train(trained, "unused.npz", *given)
    command[command.index("--out") + 1] = str(folder / "several.npz")
    assert main(command) == 0
    return folder


@pytest.fixture
def several(two_grasps: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(two_grasps, tmp_path, dirs_exist_ok=True))


@pytest.mark.slow
def test_the_best_grasp_is_named_and_all_are_ranked(
    trained: Path, several: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, ranks = str(several / "several.npz"), several / "grasps.csv"
    more = ("--model", model, "--grasps-out", str(ranks))
    assert main(forests.predict(trained, several, *more, models=())) == 0
    rows = forests.verdicts(several)
    with ranks.open() as stream:
        every = list(csv.DictReader(stream))
    assert {row["grasp"] for row in rows} == {"reference", "top"}
    best = {(r["im_id"], r["obj_id"]): r for r in every if r["rank"] == "1"}
    for row in rows:
        mine = best[row["im_id"], row["obj_id"]]
        assert (row["grasp"], row["probability"]) == (mine["grasp"], mine["probability"])
        assert "the best of 2, by 180 outcomes" in row["reason"]
    assert len(every) == 2 * len(rows)
    capsys.readouterr()
    score = ["score", "--verdicts", str(several / "v.csv")]
    assert main([*score, "--outcomes", str(several / "several.csv")]) == 0
    assert str(len(rows)) in capsys.readouterr().out
    said = refused([*score, "--outcomes", str(trained / "outcomes.csv")], capsys)
    assert "unknown grasp 'top'; known: reference" in said


def test_what_is_reachable_decides(
    trained: Path, several: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, mask = str(several / "several.npz"), several / "reachable.csv"
    rows = ["dataset,scene_id,im_id,obj_id,grasp", "made,0,0,1,top", "made,0,1,2,reference"]
    mask.write_text("\n".join(rows) + "\n")
    command = forests.predict(trained, several, "--model", model, models=())
    assert main([*command, "--reachable", str(mask)]) == 0
    found = {row["im_id"]: row for row in forests.verdicts(several)}
    assert (found["0"]["grasp"], found["1"]["grasp"]) == ("top", "reference")
    assert found["2"]["probability"] == "" and found["2"]["verdict"] == "abstain"
    assert found["2"]["reason"] == (
        "no grasp is reachable of those that the model knows of made-1: reference, top"
    )
    mask.write_text("\n".join([*rows, "made,0,2,1,tip"]) + "\n")
    said = refused([*command, "--reachable", str(mask)], capsys)
    assert "unknown grasp of made-1 'tip' (did you mean 'top'?); known: reference, top" in said
    mask.write_text("\n".join([*rows, rows[-1]]) + "\n")
    assert "rows 2, 3 are of one grasp" in refused([*command, "--reachable", str(mask)], capsys)


def test_rows_of_reachable_grasps_that_are_of_no_instance_are_said(
    trained: Path, several: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, mask = str(several / "several.npz"), several / "strange.csv"
    command = forests.predict(trained, several, "--model", model, models=())
    head, row = "dataset,scene_id,im_id,obj_id,grasp\n", "made,99,0,1,top\n"
    mask.write_text(head + row)
    said = refused([*command, "--reachable", str(mask)], capsys)
    assert (
        "no row is of an instance with a verdict; the first is of dataset made, scene_id 99" in said
    )
    mask.write_text(head + row + "made,0,0,1,top\n")
    assert main([*command, "--reachable", str(mask)]) == 0
    assert "1 of 2 instances without a verdict" in capsys.readouterr().err
    mask.write_text(head)
    assert main([*command, "--reachable", str(mask)]) == 0
    assert "no grasp is reachable and every verdict is to abstain" in capsys.readouterr().err


def test_a_certificate_is_of_choosing_among_all_grasps(
    trained: Path, several: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, path = str(several / "several.npz"), str(several / "certificate.json")
    outcomes = ["--outcomes", str(several / "several.csv"), "--rate", "0.5"]
    how = ["--unit", "image", "--allow-training-scenes", "--out", path]
    assert main(["certify", *forests.inputs(trained), "--model", model, *outcomes, *how]) == 0
    assert json.loads(Path(path).read_text())["provenance"]["grasp"] == ["reference", "top"]
    command = forests.predict(trained, several, "--model", model, "--certificate", path, models=())
    assert main(command) == 0
    log = (
        pl.read_csv(several / "v.csv").filter(verdict="attempt").rename({"principal": "estimator"})
    )
    log.with_columns(success=1).write_csv(several / "log.csv")
    watched = ["monitor", "--certificate", path, "--attempt-log", str(several / "log.csv")]
    capsys.readouterr()
    assert main([*watched, "--state", str(several / "state.json")]) == 0
    log.with_columns(success=1, grasp=pl.lit("tip")).write_csv(several / "log.csv")
    other = [*watched, "--state", str(several / "other.json")]
    assert "attempts of grasp tip, but the guarantee is for reference, top" in refused(
        other, capsys
    )
    (several / "r.csv").write_text("dataset,scene_id,im_id,obj_id,grasp\nmade,0,0,1,top\n")
    masked = [*command, "--reachable", str(several / "r.csv")]
    said = refused(masked, capsys)
    assert "the certificate is of choosing among all grasps" in said
    assert "--reachable" in said and "--certificate" in said


def test_verdicts_on_an_object_without_images(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    looks = tmp_path / "looks"

    def verdicts(*more: str) -> list[str]:
        some = ["--transferred-errors", "8", *more]
        return forests.predict(trained, tmp_path, *some, models=("simulated.npz",))

    assert main(verdicts("--objects", "made-2", "--transferred-to", str(looks))) == 0
    out, err = capsys.readouterr()
    assert "8 verdicts" in out
    rows = forests.verdicts(tmp_path)
    assert {(row["dataset"], row["obj_id"], row["scene_id"]) for row in rows} == {
        ("made", "2", "0")
    }
    assert [int(row["im_id"]) for row in rows] == list(range(8))
    assert str(looks / "b_made-test.csv") in err and (looks / "b_made-test.csv").exists()
    said = refused(verdicts(), capsys)
    assert "name the objects" in said and "--objects" in said
    said = refused(verdicts("--objects", "made-2", "--camera-poses", "a.csv"), capsys)
    assert "neither images nor camera poses" in said
