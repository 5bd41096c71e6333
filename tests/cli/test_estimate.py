"""The verb estimate."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from bop_images import box, write_boxes, write_dataset
from crude import BoxEstimator, command, make_python, verb
from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import jittered, write_detections
from graspcast.bop.results import read_results
from graspcast.cli import main


@pytest.fixture(scope="session")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of another virtual environment, which has no package at all."""
    return make_python(tmp_path_factory.mktemp("other env"))


@pytest.fixture
def dataset(tmp_path: Path) -> BopDataset:
    return write_dataset(tmp_path / "made")


@pytest.fixture
def boxes(dataset: BopDataset, tmp_path: Path) -> Path:
    path = tmp_path / "my boxes.json"
    write_detections(path, jittered(dataset, 0))
    return path


def test_the_verb_runs_a_command(
    python: Path, dataset: BopDataset, boxes: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = boxes.with_name("out.csv")
    assert main(verb(dataset, boxes, out, command(python), "--timeout", "60")) == 0
    printed = capsys.readouterr()
    assert printed.out == f"{out}: 6 poses in 3 images, from 6 detections in 3\n"
    assert "jittered ground truth, seed 0, not a detector" in printed.err
    assert len(read_results(out)) == 6


def test_a_command_is_given_the_chosen_detections(
    python: Path, dataset: BopDataset, boxes: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, targets = boxes.with_name("out.csv"), boxes.with_name("targets.json")
    targets.write_text('[{"scene_id": 1, "im_id": 3}, {"scene_id": 1, "im_id": 8}]')
    chosen = ["--targets", str(targets), "--top", "1", "--min-score", "0.5"]
    assert main(verb(dataset, boxes, out, command(python), *chosen)) == 0
    printed = capsys.readouterr()
    assert printed.out == f"{out}: 4 poses in 2 images, from 4 detections in 2\n"
    assert f"{boxes}: of 6 detections 2 are no targets" in " ".join(printed.err.split("\n"))
    assert main(verb(dataset, boxes, out, command(python), "--min-score", "2")) == 2
    assert "the highest score is 1) (see --min-score, --targets)" in capsys.readouterr().err


def test_the_verb_runs_an_estimator_of_ours(
    dataset: BopDataset,
    boxes: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[object] = []

    def load(name: str, weights: object) -> BoxEstimator:
        asked.extend([name, weights])
        return BoxEstimator(dataset.models)

    monkeypatch.setattr("graspcast.perception.built_in", load)
    out = boxes.with_name("out.csv")
    assert main(verb(dataset, boxes, out, "direct", "--weights", "own.onnx")) == 0
    assert asked == ["direct", Path("own.onnx")]
    assert "6 poses in 3 images, from 6 detections in 3" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("estimator", "more", "says"),
    [
        ("dens", [], r"'dens' \(did you mean 'dense'\?\); known: .*Other estimators are commands"),
        ("run {bop}", [], "no {out}, the file to which"),
        ("run {out}", ["--weights", "a.onnx"], "--weights is for a built-in estimator"),
        ("dense", ["--timeout", "5"], "--timeout is for a command; dense is built in"),
        ("dense", ["--split", "train"], "no RGB images here"),
    ],
)
def test_the_verb_refuses(
    dataset: BopDataset,
    boxes: Path,
    capsys: pytest.CaptureFixture[str],
    estimator: str,
    more: list[str],
    says: str,
) -> None:
    out = boxes.with_name("out.csv")
    assert main(verb(dataset, boxes, out, estimator, *more)) == 2
    assert re.search(says, capsys.readouterr().err)
    assert not out.exists()


def test_the_verb_counts_what_it_leaves_out(
    python: Path, dataset: BopDataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_boxes(tmp_path / "d.json", box(), box(category_id=7), box(bbox=[0, 0, 0, 0]))
    out = tmp_path / "out.csv"
    assert main(verb(dataset, path, out, "dense")) == 2
    assert "object 7 is not in" in capsys.readouterr().err
    copy = (
        f"{shlex.quote(str(python))} -c 'import sys; open(sys.argv[1], \"w\").write(sys.argv[2])'"
    )
    rows = "scene_id,im_id,obj_id,score,R,t,time\n1,3,1,1,1 0 0 0 1 0 0 0 1,0 0 800,-1\n"
    estimator = f"{copy} {{out}} {shlex.quote(rows)}"
    assert main(verb(dataset, path, out, estimator, "--lenient")) == 0
    printed = capsys.readouterr()
    assert "left out 1 (object without a model)" in printed.err
    assert "left out 1 (bad entry)" in printed.err
    assert "1 pose in 1 image, from 1 detection in 1" in printed.out


@pytest.mark.parametrize("seconds", ["0", "-1", "nan", "inf", "soon"])
def test_the_time_out_is_a_number_of_seconds(seconds: str) -> None:
    with pytest.raises(SystemExit):
        main(["estimate", "--bop", "a", "--detections", "b", "--timeout", seconds])


def test_a_time_out_names_its_option(
    python: Path, dataset: BopDataset, boxes: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sleep = f"{shlex.quote(str(python))} -c 'import time; time.sleep(60)' {{out}}"
    assert main(verb(dataset, boxes, boxes.with_name("out.csv"), sleep, "--timeout", "0.5")) == 2
    message = capsys.readouterr().err
    assert "timed out after 0.5 s" in message
    assert "(see --timeout)" in message


def test_an_output_called_as_one_of_another_dataset_is_told(
    dataset: BopDataset,
    boxes: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("graspcast.perception.built_in", lambda *_: BoxEstimator(dataset.models))
    for name, told in (("a_bin-test.csv", True), ("a_made-test.csv", False), ("a.csv", False)):
        assert main(verb(dataset, boxes, boxes.with_name(name), "direct")) == 0
        assert ("a CSV of another dataset than made" in capsys.readouterr().err) == told


def test_odd_boxes_are_told(
    dataset: BopDataset,
    boxes: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("graspcast.perception.built_in", lambda *_: BoxEstimator(dataset.models))
    write_boxes(boxes, box(bbox=[10, 20, 90, 60]))
    assert main(verb(dataset, boxes, boxes.with_name("out.csv"), "direct")) == 0
    assert "are they two corners?" in capsys.readouterr().err
