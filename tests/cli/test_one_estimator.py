"""One estimator, one view: train, predict and certify from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import one_estimator as world
from commands import refused
from graspcast.bop.results import read_results, write_results
from graspcast.cli import main
from graspcast.forecasting.forecaster import Forecaster

# Forests are trained by the command.
pytestmark = pytest.mark.slow

RESTS = "; one view of one estimator: rests on the pose and its score, mostly visibility"
WITH_IMAGE = (
    "; one view of one estimator: rests on the pose, its score and the image, mostly visibility"
)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The dataset, ``plain.npz`` without images and ``image.npz`` with them."""
    root = tmp_path_factory.mktemp("alone")
    world.write_world(root)
    assert main(world.train_command(root, root / "plain.npz", "--folds", "0")) == 0
    images = ("--images", "--folds", "0")
    assert main(world.train_command(root, root / "image.npz", *images)) == 0
    return root


@pytest.mark.slow
def test_train_scores_it_and_says_what_it_rests_on(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    more = ("--folds", "2", "--json", str(tmp_path / "card.json"))
    assert main(world.train_command(root, tmp_path / "m.npz", *more)) == 0
    out, err = capsys.readouterr()
    assert "visibility, cross-validated scores" in out
    assert "m.npz: a alone, one view, p gripper, 2 objects, 96 samples" in out
    assert (
        "Warning: one estimator: from one view forecasts rest on the object and the pose and its "
        "score, mostly visibility, and are much weaker than those of a consensus" in err
    )
    card = json.loads((tmp_path / "card.json").read_text())["card"]
    assert (card["method"], card["features"], card["supporters"]) == (
        "visibility",
        "visibility",
        [],
    )
    assert card["scores"]["unseen_scenes"]["n"] == 96
    assert card["scores"]["unseen_scenes"]["auroc"] > 0.8


def test_predict_answers_and_the_reason_says_on_how_little(root: Path, tmp_path: Path) -> None:
    rows = world.predict(root, (root / "plain.npz",), tmp_path / "v.csv", "--threshold", "0.6")
    assert len(rows) == 96
    assert {row["verdict"] for row in rows} == {"attempt", "abstain"}
    for row in rows:
        p = float(row["probability"])
        assert (row["verdict"] == "attempt") is (p >= 0.6)
        assert row["reason"] == f"probability {p:.3f} {'>=' if p >= 0.6 else '<'} 0.6{RESTS}"
    forecaster = Forecaster.load(root / "plain.npz")
    table = read_results(root / "a_d-test.csv")
    for i in (0, 31, 95):
        score = float(table.score[i])
        name = f"d-{table.obj_id[i]}"
        verdict = forecaster.predict({"a": table.cam_T_obj[i]}, name, score=score)
        assert verdict.probability == pytest.approx(float(rows[i]["probability"]), abs=1e-5)
        without = forecaster.predict({"a": table.cam_T_obj[i]}, name)
        assert "rests on the pose, mostly visibility" in without.reason


def test_below_the_threshold_the_advice_is_to_look_again(root: Path, tmp_path: Path) -> None:
    looks = ("--threshold", "0.6", "--max-looks", "3")
    rows = world.predict(root, (root / "plain.npz",), tmp_path / "v.csv", *looks)
    for row in rows:
        sure = float(row["probability"]) >= 0.6
        assert row["verdict"] == ("attempt" if sure else "look again")
        assert RESTS in row["reason"]
        if not sure:
            vector = np.array(row["look_direction"].split(), dtype=float)
            assert np.linalg.norm(vector) == pytest.approx(1, abs=1e-5)
            assert "look again" in row["reason"]
            assert row["reason"].count("one view") == 1


@pytest.mark.slow
def test_images_are_used_where_there_are_any(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = (root / "image.npz",)
    capsys.readouterr()
    rows = world.predict(root, model, tmp_path / "v.csv", "--images")
    err = capsys.readouterr().err
    assert "of 96 instances; none of" in err
    assert "none of 2: the image has one colour throughout" in err
    assert "none of 16: there is no image 6/0, …" in err
    fitted = int(err.split("image fit of ")[1].split()[0])
    assert 40 < fitted < 80
    assert sum(row["reason"].endswith(WITH_IMAGE) for row in rows) == fitted
    for row in rows:
        if (row["scene_id"], row["im_id"]) == ("5", "0") or row["scene_id"] == "6":
            assert row["reason"].endswith(RESTS)
    for looks in ("1", "2"):  # both ways to the model
        again = world.predict(
            root, model, tmp_path / "w.csv", "--images", "--max-looks", looks, "--guide", "a"
        )
        assert [r["probability"] for r in again] == [r["probability"] for r in rows]
    # Without images it says what a model says that never saw any.
    without = world.predict(root, model, tmp_path / "x.csv")
    plain = world.predict(root, (root / "plain.npz",), tmp_path / "y.csv")
    assert [r["probability"] for r in without] == [r["probability"] for r in plain]
    capsys.readouterr()
    world.predict(root, (root / "plain.npz",), tmp_path / "y.csv", "--images")
    assert "--images makes no difference" in capsys.readouterr().err


def test_unknown_objects_and_poses_elsewhere_are_abstained_from(root: Path, tmp_path: Path) -> None:
    table = read_results(root / "a_d-test.csv").select(np.arange(4))
    table.obj_id[1] = 9
    table.cam_T_obj[2, 2, 3] = 4.0
    write_results(tmp_path / "a_d-test.csv", table)
    out = tmp_path / "v.csv"
    given = ["predict", "--estimates", f"a={tmp_path / 'a_d-test.csv'}", "--threshold", "0"]
    assert main([*given, "--model", str(root / "plain.npz"), "--out", str(out)]) == 0
    import csv

    with out.open() as stream:
        rows = {(row["im_id"], row["obj_id"]): row for row in csv.DictReader(stream)}
    unknown = rows["0", "9"]
    assert (unknown["verdict"], unknown["probability"]) == ("abstain", "")
    assert unknown["reason"] == "the model was not trained for d-9"
    far = rows["1", "1"]
    assert far["verdict"] == "abstain"
    assert "a's pose is 4.0" in far["reason"]
    assert rows["0", "1"]["verdict"] == "attempt"


@pytest.mark.slow
def test_a_consensus_is_not_touched_and_one_estimator_serves_where_asked(
    root: Path, tmp_path: Path
) -> None:
    both = ("a", "b")
    pair, alone = tmp_path / "pair.npz", root / "plain.npz"
    more = ("--method", "direct", "--folds", "0")
    assert main(world.train_command(root, pair, *more, names=both)) == 0
    by_pair = world.predict(root, (pair,), tmp_path / "p.csv", names=both)
    together = world.predict(root, (pair, alone), tmp_path / "v.csv", names=both)
    for before, row in zip(by_pair, together, strict=True):
        if row["im_id"] == str(world.IMAGES - 1):
            assert before["reason"] == "no estimate by b"
            assert row["reason"].endswith(f"{RESTS}; with no supporter")
            assert row["probability"]
        else:
            assert row["probability"] == before["probability"]
            assert row["reason"] == f"{before['reason']}; with b"


@pytest.mark.slow
def test_certify_takes_it_with_and_without_images(root: Path, tmp_path: Path) -> None:
    for model, more in (("plain.npz", ()), ("image.npz", ("--images",))):
        given = ["certify", *world.inputs(root), "--model", str(root / model), "--unit", "image"]
        given += ["--outcomes", str(root / "outcomes.csv"), "--allow-training-scenes", "--rate"]
        path = tmp_path / f"{model}.json"
        assert main([*given, "0.8", "--out", str(path), *more]) == 0
        certified = ("--certificate", str(path), *more)
        rows = world.predict(root, (root / model,), tmp_path / "v.csv", *certified)
        assert any(row["verdict"] == "attempt" for row in rows)


def test_what_cannot_be_is_told(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "x.npz"
    command = world.train_command(root, out)
    for method in ("threshold", "MLP-O", "two-stage"):
        said = refused([*command, "--method", method], capsys)
        assert f"the method {method} takes at least two estimators" in said
    said = refused([*command, "--folds", "0", "--unseen-objects"], capsys)
    assert "one estimator alone learns nothing of objects that are not in training" in said
    both = world.train_command(root, out, "--images", names=("a", "b"))
    assert "images are looked at with one estimator alone" in refused(both, capsys)
    text = (root / "a_d-test.csv").read_text().replace("score", "confidence", 1)
    (tmp_path / "a_d-test.csv").write_text(text)
    without = [arg.replace(str(root / "a_d"), str(tmp_path / "a_d")) for arg in command]
    assert "no column 'score'" in refused(without, capsys)
    assert not out.exists()


def test_a_directory_without_images_and_a_broken_image(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    world.write_world(tmp_path)
    command = world.train_command(tmp_path, tmp_path / "x.npz", "--images", "--folds", "0")
    path = tmp_path / "d" / "test" / "000001" / "rgb" / "000003.png"
    path.write_bytes(path.read_bytes()[:60])
    assert str(path) in refused(command, capsys)
    Image.new("L", (96, 64)).save(path)
    assert "is grayscale" in refused(command, capsys)
    for image in (tmp_path / "d" / "test").glob("*/rgb/*"):
        image.unlink()
    said = refused(command, capsys)
    assert "there is no image of any instance, for example: there is no image 1/0" in said
    assert "(see --images, --bop)" in said
