"""Options that several verbs share: inputs, objects, scenes, outputs."""

from __future__ import annotations

import re
from pathlib import Path

import polars as pl
import pytest

from commands import refused
from graspcast.bop.results import write_results
from graspcast.cli import main
from network_commands import inputs, predict, train
from poses import ROW, random_poses, results_of, write_csv


def test_ground_truth_may_lie_elsewhere(world: Path) -> None:
    (world / "made" / "test").rename(world / "truth")
    assert main(["errors", *inputs(world, "a"), "--ground-truth", str(world / "truth")]) == 0


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
    assert "dropped 1 rows (object without a model: 7)" in capsys.readouterr().err
    assert main(["errors", *inputs(world, "a"), "--objects", "1"]) == 0
    assert main(["errors", *inputs(world, "a"), "--objects", "made-1", "other-7"]) == 0
    assert "an object is given as NUMBER, or DATASET-NUMBER (lmo-5), not" in refused(
        ["errors", *inputs(world, "a"), "--objects", "can"], capsys
    )


def test_a_dataset_given_twice(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    again = ["--bop", str(world / "made")]
    said = refused(["errors", *inputs(world, "a"), *again], capsys)
    assert "there is already a dataset made" in said


@pytest.mark.slow
def test_only_some_scenes(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(train(world, "--folds", "0", "--scenes", "0-2", "4")) == 0
    assert "1 object, 40 samples" in capsys.readouterr().out
    assert main(predict(world, "--scenes", "3", "5")) == 0
    scenes = pl.read_csv(world / "v.csv")["scene_id"]
    assert sorted(set(scenes.to_list())) == [3, 5]
    said = refused(predict(world, "--scenes", "7"), capsys)
    assert "no estimate is left in scene 7; the file has objects 1 in scenes 0-5" in said
    for wrong in ("x", "3-", "4-2", "-1", "²", "0-99999999999"):
        with pytest.raises(SystemExit):
            main(predict(world, "--scenes", wrong))


def test_outputs_that_cannot_be_written(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (world / "file").write_text("")
    said = refused([*train(world, "--folds", "0"), "--out", str(world / "file" / "m.npz")], capsys)
    assert "cannot be written" in said


def test_all_outputs_are_checked_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(write_csv(tmp_path / "a_x-test.csv", ROW))
    folder, side = tmp_path / "folder", tmp_path / "side.csv"
    folder.mkdir()
    estimates = ["--estimates", f"a={path}"]
    trained = [*estimates, "--principal", "a", "--gripper", "g", "--outcomes", path]
    model = [*estimates, "--model", str(tmp_path / "no.npz")]
    for verb, out, other in (
        (["fuse", *estimates], "--out", "--covariances"),
        (["fuse", *estimates], "--covariances", "--out"),
        (["predict", *model], "--out", "--stages"),
        (["predict", *model], "--stages", "--out"),
        (["train", *trained], "--out", "--json"),
        (["train", *trained], "--json", "--out"),
        (["certify", *model, "--outcomes", path], "--json", "--out"),
        (["score", "--verdicts", path, "--outcomes", path], "--json", ""),
    ):
        rest = [other, str(side)] if other else []
        said = refused([*verb, out, str(folder), *rest], capsys)
        assert f"is a directory, and would be replaced (see {out})" in said
        said = refused([*verb, out, str(Path(path) / "deep" / "x"), *rest], capsys)
        assert "cannot be written" in said and f"(see {out})" in said
        assert not side.exists()


def test_a_missing_directory_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_csv(tmp_path / "a_x-test.csv", ROW)
    said = refused(["errors", "--bop", str(tmp_path / "no"), "--estimates", f"a={path}"], capsys)
    assert "no such directory" in said


def test_no_file_that_is_read_is_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, other = tmp_path / "v.csv", tmp_path / "o.csv"
    path.write_text("verdicts")
    other.write_text("outcomes")
    asked = ["score", "--verdicts", str(path), "--outcomes", str(other), "--json"]
    assert "is read (--outcomes) and would be replaced (--json)" in refused(
        [*asked, str(other)], capsys
    )
    named = ["predict", "--estimates", f"a={path}", "--model", str(other), "--out"]
    assert "is read (--estimates) and would be" in refused([*named, str(path)], capsys)
    assert "is read (--model) and would be" in refused([*named, str(other)], capsys)
    train = ["certify", "--model", str(other), "--estimates", f"a={path}", "--outcomes", str(path)]
    said = refused([*train, "--out", "c.json", "--json", "c.json"], capsys)
    assert "c.json: is given as --out and as --json" in said
    said = refused([*named, "v2.csv", "--grasps-out", "v2.csv"], capsys)
    assert "v2.csv: is given as --out and as --grasps-out" in said
    assert (path.read_text(), other.read_text()) == ("verdicts", "outcomes")


def test_an_equals_sign_in_the_path_of_a_dataset(
    world: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (world / "a=b").mkdir()
    (world / "made").rename(world / "a=b" / "made")
    estimates = ["--estimates", f"a={world / 'a_made-test.csv'}"]
    assert main(["errors", "--bop", str(world / "a=b" / "made"), *estimates]) == 0
    monkeypatch.chdir(world)
    assert main(["errors", "--bop", "a=b/made", *estimates]) == 0
    (world / "a=b" / "made").rename(world / "my=kit")
    assert main(["errors", "--bop", "made=my=kit", *estimates]) == 0
