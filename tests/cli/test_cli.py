"""The command line: what it prints, what it writes, and how it refuses."""

from __future__ import annotations

import csv
import dataclasses
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import graspcast
from commands import refused
from graspcast.bop.results import write_results
from graspcast.bop.units import millimetres
from graspcast.cli import main, parser
from poses import ROW, nudged, random_poses, results_of, write_csv, write_models

N = 60
ENV = {**os.environ, "PYTHONPATH": str(Path(graspcast.__file__).parents[1])}


@pytest.fixture
def world(tmp_path: Path) -> Path:
    """A dataset "made" of one object, three estimators' CSVs, ground truth and outcomes."""
    bop = tmp_path / "made"
    write_models(bop / "models", obj_1={}, obj_2={})
    camera = {"fx": 570.0, "fy": 570.0, "cx": 320.0, "cy": 240.0}
    (bop / "camera.json").write_text(json.dumps(camera))
    truth = random_poses(N)
    for scene in range(6):
        folder = bop / "test" / f"{scene:06d}"
        folder.mkdir(parents=True)
        images = {
            str(i): [
                {
                    "obj_id": 1,
                    "cam_R_m2c": truth[i, :3, :3].ravel().tolist(),
                    "cam_t_m2c": millimetres(truth[i, :3, 3]).tolist(),
                }
            ]
            for i in range(scene, N, 6)
        }
        (folder / "scene_gt.json").write_text(json.dumps(images))
    outcomes = []
    for k, name in enumerate("abc"):
        poses = nudged(truth, k, metres=0.02)
        table = dataclasses.replace(results_of(poses), scene_id=np.arange(N) % 6)
        write_results(tmp_path / f"{name}_made-test.csv", table)
        error = np.linalg.norm(poses[:, :3, 3] - truth[:, :3, 3], axis=-1)
        outcomes += [
            (name, "made", i % 6, i, 1, "parallel", int(error[i] < 0.03)) for i in range(N)
        ]
    columns = ["estimator", "dataset", "scene_id", "im_id", "obj_id", "gripper", "success"]
    pl.DataFrame(outcomes, schema=columns, orient="row").write_csv(tmp_path / "outcomes.csv")
    return tmp_path


def inputs(world: Path, names: str = "abc") -> list[str]:
    out = ["--bop", str(world / "made")]
    for name in names:
        out += ["--estimates", f"{name}={world / f'{name}_made-test.csv'}"]
    return out


def train(world: Path, *more: str, names: str = "abc") -> list[str]:
    out = ["train", *inputs(world, names), "--principal", "a", "--gripper", "parallel"]
    out += ["--outcomes", str(world / "outcomes.csv"), "--out", str(world / "m.npz")]
    return [*out, "--epochs", "30", "--members", "2", *more]


def predict(world: Path, *more: str, names: str = "abc") -> list[str]:
    paths = ["--model", str(world / "m.npz"), "--out", str(world / "v.csv")]
    return ["predict", *inputs(world, names), *paths, *more]


@pytest.mark.slow
def test_from_estimates_to_verdicts(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(train(world, "--folds", "3", "--json", str(world / "card.json"))) == 0
    out, _ = capsys.readouterr()
    assert "unseen scenes" in out
    assert "a with b, c, parallel gripper, 1 objects, 60 samples" in out
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


def test_verdicts_in_python_are_those_of_the_command(world: Path) -> None:
    assert main(train(world, "--folds", "0")) == 0
    assert main(predict(world)) == 0
    forecaster = graspcast.Forecaster.load(world / "m.npz")
    tables = {n: graspcast.read_results(world / f"{n}_made-test.csv") for n in "abc"}
    models = {"made": graspcast.BopDataset(world / "made").models}
    with (world / "v.csv").open() as stream:
        written = {int(r["im_id"]): float(r["probability"]) for r in csv.DictReader(stream)}
    for i in (0, 17, 59):
        poses = {name: table.cam_T_obj[i] for name, table in tables.items()}
        verdict = forecaster.predict(poses, "made-1", models=models)
        assert verdict.probability == pytest.approx(written[i], abs=1e-5)


def test_where_a_supporter_found_nothing_the_verdict_is_to_abstain(
    world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(train(world, "--folds", "0")) == 0
    path = world / "b_made-test.csv"
    lines = path.read_text().splitlines()
    fields = lines[1].split(",")
    fields[4:6] = ["1 0 0 0 1 0 0 0 1", "0 0 0"]
    path.write_text("\n".join([lines[0], ",".join(fields), *lines[3:]]) + "\n")
    capsys.readouterr()
    assert main(predict(world)) == 0
    err = capsys.readouterr().err
    assert "dropped 1 rows (placeholder)" in err
    assert "dropped instances without an estimate: 2 by b" in err
    with (world / "v.csv").open() as stream:
        rows = {int(r["im_id"]): r for r in csv.DictReader(stream)}
    assert len(rows) == N
    for image in (0, 1):
        assert rows[image]["verdict"] == "abstain"
        assert rows[image]["probability"] == ""
        assert rows[image]["reason"] == "no estimate by b"


@pytest.mark.parametrize("method", ["threshold", "MLP"])
def test_the_other_methods(world: Path, method: str) -> None:
    assert main(train(world, "--folds", "0", "--method", method)) == 0
    assert main(predict(world)) == 0


def test_errors_prints_a_table_and_writes_every_estimate(
    world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["errors", *inputs(world, "ab"), "--json", str(world / "e.json")]
    assert main([*arguments, "--out", str(world / "e.parquet"), "--statistic", "mean"]) == 0
    out, _ = capsys.readouterr()
    assert "a on made, mean" in out
    assert "MSPD" in out
    table = pl.read_parquet(world / "e.parquet")
    assert len(table) == 2 * N
    figures = json.loads((world / "e.json").read_text())["errors"]["made"]["a"]
    mean = table.filter(pl.col("estimator") == "a")["translation_mm"].mean()
    assert figures[0]["translation_mm_mean"] == pytest.approx(mean)
    assert 0 < figures[0]["ray_share_mean"] < 1


def test_errors_have_a_shape(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["errors", *inputs(world, "ab"), "--json", str(world / "e.json"), "--shape"]
    assert main(arguments) == 0
    out, _ = capsys.readouterr()
    assert "rank correlation of errors on made" in out and "> 90°" in out
    shape = json.loads((world / "e.json").read_text())["shape"]["made"]
    assert set(shape["tails"]) == {"a", "b"}
    assert shape["tails"]["a"][-1]["n"] == shape["correlations"][0]["n"] == N


def test_ground_truth_may_lie_elsewhere(world: Path) -> None:
    (world / "made" / "test").rename(world / "truth")
    assert main(["errors", *inputs(world, "a"), "--ground-truth", str(world / "truth")]) == 0


def test_unknown_names_are_answered_with_the_known(
    world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused([*train(world), "--principal", "d"], capsys)
    assert "unknown estimator 'd'; known: a, b, c" in said
    said = refused([*train(world), "--gripper", "paralel"], capsys)
    assert "'paralel' (did you mean 'parallel'?); known: parallel" in said
    assert not (world / "m.npz").exists()


def test_csvs_of_another_dataset_are_refused(
    world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = world / "a_other-test.csv"
    (world / "a_made-test.csv").rename(other)
    arguments = ["--bop", str(world / "made"), "--estimates", f"a={other}"]
    said = refused(["errors", *arguments], capsys)
    assert "a CSV of dataset other, but the BOP directories are of made; if one of" in said
    nameless = other.rename(world / "a.csv")
    assert main(["errors", "--bop", str(world / "made"), "--estimates", f"a={nameless}"]) == 0


def test_other_scenes_are_refused(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_results(world / "a_made-test.csv", results_of(random_poses(5), scene_id=99))
    assert "is it a CSV of another dataset or split?" in refused(
        ["errors", *inputs(world, "a")], capsys
    )
    said = refused(train(world, "--folds", "0"), capsys)
    assert "no instance of made has a pose by every estimator (a: 5 rows, b: 60 rows" in said


def test_objects_without_a_model(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = world / "a_made-test.csv"
    path.write_text(path.read_text() + ROW.replace("1,2,3", "0,0,7") + "\n")
    said = refused(["errors", *inputs(world, "a")], capsys)
    assert re.search(r"a_made-test\.csv, line 62: object 7 is not in .*which has 1, 2", said)
    assert main(["errors", *inputs(world, "a"), "--lenient"]) == 0
    assert "dropped 1 rows (object without a model)" in capsys.readouterr().err
    assert main(["errors", *inputs(world, "a"), "--objects", "1"]) == 0
    assert main(["errors", *inputs(world, "a"), "--objects", "made-1", "other-7"]) == 0
    assert "an object is given as NUMBER, or DATASET-NUMBER (lmo-5), not" in refused(
        ["errors", *inputs(world, "a"), "--objects", "can"], capsys
    )


def test_a_dataset_given_twice(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    again = ["--bop", str(world / "made")]
    said = refused(["errors", *inputs(world, "a"), *again], capsys)
    assert "there is already a dataset made" in said


def test_only_some_scenes(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(train(world, "--folds", "0", "--scenes", "0-2", "4")) == 0
    assert "1 objects, 40 samples" in capsys.readouterr().out
    assert main(predict(world, "--scenes", "3", "5")) == 0
    scenes = pl.read_csv(world / "v.csv")["scene_id"]
    assert sorted(set(scenes.to_list())) == [3, 5]
    said = refused(predict(world, "--scenes", "7"), capsys)
    assert "no estimate in the wanted scenes 7; it has scenes 0, 1, 2, 3, 4, 5" in said
    for wrong in ("x", "3-", "4-2", "-1", "²", "0-99999999999"):
        with pytest.raises(SystemExit):
            main(predict(world, "--scenes", wrong))


def test_models_of_other_estimators_or_objects(
    world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(train(world, "--folds", "0")) == 0
    said = refused(predict(world, names="ab"), capsys)
    assert "there are no estimates by c for the model with 2 supporters; given: a, b" in said
    for name in "abc":
        path = world / f"{name}_made-test.csv"
        write_results(path, results_of(random_poses(5), obj_id=2))
    said = refused(predict(world), capsys)
    assert "this model was not trained for made-2; it knows made-1" in said
    assert not (world / "v.csv").exists()


def test_truncated_models(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(train(world, "--folds", "0")) == 0
    path = world / "m.npz"
    path.write_bytes(path.read_bytes()[:-40])
    assert "m.npz: is not a complete model file" in refused(predict(world), capsys)
    path.unlink()
    assert "No such file" in refused(predict(world), capsys)


def test_too_little_to_learn_from(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = pl.read_csv(world / "outcomes.csv")
    table.with_columns(success=pl.lit(1)).write_csv(world / "outcomes.csv")
    said = refused(train(world, "--folds", "0"), capsys)
    assert "60 outcomes of a with 60 successes are too few" in said
    table.filter(pl.col("im_id") > 1000).write_csv(world / "outcomes.csv")
    refused(train(world, "--folds", "0"), capsys)


def test_metres_and_bad_rows_and_columns(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for row, says in (
        (ROW.replace("10 20 900", "0.01 0.02 0.9"), "t seems to be in metres"),
        (ROW.replace("1 0 0 0 1 0 0 0 1", "1 0 0 0 1 0 0 0 2"), "line 2: R is 1 away"),
        (ROW.replace("0.5", "nan"), "line 2: score is 'nan'"),
    ):
        write_csv(world / "a_made-test.csv", row)
        assert says in refused(["errors", *inputs(world, "a")], capsys)
    write_csv(world / "a_made-test.csv", ROW, header="scene_id,im_id,obj,score,R,t,time")
    assert "no column 'obj_id'" in refused(["errors", *inputs(world, "a")], capsys)


def test_outputs_that_cannot_be_written(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (world / "file").write_text("")
    said = refused([*train(world, "--folds", "0"), "--out", str(world / "file" / "m.npz")], capsys)
    assert "cannot be written" in said


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["unknown"],
        ["predict"],
        ["errors", "--bop", "x", "--estimates", "no-equals-sign"],
        ["reproduce", "--data", "x", "--seeds", "0"],
        ["predict", "--model", "m", "--out", "v", "--estimates", "a=b", "--threshold", "1.5"],
    ],
)
def test_wrong_usage_exits_with_2(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2


def test_directories_that_are_not_what_they_should_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "no published/lmo/trials.csv here" in refused(
        ["reproduce", "--data", str(tmp_path)], capsys
    )
    assert "no folder Pose-Estimates here" in refused(
        ["import-release", str(tmp_path), str(tmp_path / "out")], capsys
    )
    path = write_csv(tmp_path / "a_x-test.csv", ROW)
    said = refused(["errors", "--bop", str(tmp_path / "no"), "--estimates", f"a={path}"], capsys)
    assert "no such directory; --bop takes a BOP dataset's directory" in said


def test_import_release_says_what_it_found(
    data_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    release = data_dir / "raw" / "Consensus-Driven-Uncertainty"
    assert main(["import-release", str(release), str(tmp_path / "out")]) == 0
    assert "trials 10696; instances 4125, of which 4 without a pose" in capsys.readouterr().out


def test_every_verb_explains_itself() -> None:
    verbs = next(a for a in parser()._actions if a.dest == "verb").choices
    assert verbs is not None
    for name, verb in verbs.items():  # type: ignore[union-attr, attr-defined]
        assert len(verb.description) > 60, name
        undocumented = [a.dest for a in verb._actions if not a.help]
        assert not undocumented, (name, undocumented)


def test_the_program_as_a_user_starts_it(world: Path) -> None:
    def start(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "graspcast", *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=False, env=ENV)

    version = start("--version")
    assert version.stdout.strip() == f"graspcast {graspcast.__version__}"
    wrong = start("errors", "--bop", str(world / "made"), "--estimates", f"a={world / 'none.csv'}")
    assert wrong.returncode == 2
    assert wrong.stdout == ""
    assert wrong.stderr.startswith("graspcast errors: ")
    assert "Traceback" not in wrong.stderr
