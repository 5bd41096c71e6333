"""An estimator on the images of a dataset, and the verb."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from numpy import ndarray
from numpy.testing import assert_allclose

from bop_images import FOCAL, IMAGES, SIZE, box, write_boxes, write_image
from crude import BoxEstimator, command, left_behind, run, verb
from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import Detections, read_detections
from graspcast.bop.results import read_results
from graspcast.cli import main
from graspcast.errors import (
    FormatError,
    InputError,
    UnknownNameError,
)
from graspcast.perception.estimator import Poses
from graspcast.perception.run import run_estimator


def test_the_image_loop_agrees_with_the_command(
    python: Path, dataset: BopDataset, boxes: Path, tmp_path: Path
) -> None:
    estimator = BoxEstimator(dataset.models)
    seen: list[tuple[float, str]] = []
    results = run_estimator(
        estimator,
        dataset,
        read_detections(boxes, dataset),
        tmp_path / "own.csv",
        progress=lambda share, words: seen.append((share, words)),
    )
    run(python, dataset, boxes, tmp_path / "foreign.csv")
    own, foreign = read_results(tmp_path / "own.csv"), read_results(tmp_path / "foreign.csv")
    assert_allclose(own.cam_T_obj, foreign.cam_T_obj, atol=1e-12)
    assert np.array_equal(own.cam_T_obj, results.cam_T_obj)
    assert seen == [(i / 3, f"image {s}/{m}") for i, (s, m) in enumerate(IMAGES)]
    for (image, K, detections), key in zip(estimator.calls, IMAGES, strict=True):
        assert np.array_equal(image, dataset.image(*key))
        assert_allclose(K, [[FOCAL, 0, SIZE[0] / 2], [0, FOCAL, SIZE[1] / 2], [0, 0, 1]])
        assert set(zip(detections.scene_id, detections.im_id, strict=True)) == {key}
        times = own.time_s[(own.scene_id == key[0]) & (own.im_id == key[1])]
        assert len(set(times.tolist())) == 1  # the seconds that the image took
        assert times[0] >= 0.01


def test_only_images_with_detections_are_read_and_nothing_found_is_no_row(
    dataset: BopDataset, tmp_path: Path
) -> None:
    write_image(dataset.images[2, 3], mode="RGBA")  # would be refused
    small = box(1, 8, bbox=[10, 10, 3, 3])
    path = write_boxes(tmp_path / "d.json", box(), box(1, 8), small)
    estimator = BoxEstimator(dataset.models)
    results = run_estimator(estimator, dataset, read_detections(path), tmp_path / "out.csv")
    assert results.im_id.tolist() == [3, 8]
    assert [len(call[2]) for call in estimator.calls] == [1, 2]


def test_objects_that_the_estimator_does_not_know(dataset: BopDataset, tmp_path: Path) -> None:
    path = write_boxes(tmp_path / "d.json", box(category_id=5), box())
    estimator = BoxEstimator(dataset.models)
    estimator.obj_ids = (1,)
    found, out = read_detections(path, dataset), tmp_path / "out.csv"
    with pytest.raises(UnknownNameError, match=r"unknown object '5'; known: 1. box was trained"):
        run_estimator(estimator, dataset, found, out)
    assert not out.exists()
    results = run_estimator(estimator, dataset, found, out, lenient=True)
    assert results.dropped == {"object that the estimator does not know": 1}
    assert results.obj_id.tolist() == [1]
    estimator.obj_ids = (9,)
    with pytest.raises(InputError, match="no detection that box could use"):
        run_estimator(estimator, dataset, found, out, lenient=True)


def test_a_bad_image_ends_it_without_results(dataset: BopDataset, boxes: Path) -> None:
    write_image(dataset.images[2, 3], mode="RGBA")
    folder = boxes.parent / "results"
    with pytest.raises(FormatError, match=r"000003.png: has an alpha channel"):
        run_estimator(
            BoxEstimator(dataset.models), dataset, read_detections(boxes), folder / "out.csv"
        )
    assert left_behind(folder) == []


def test_poses_that_are_none_are_refused(dataset: BopDataset, boxes: Path) -> None:
    class Broken(BoxEstimator):
        def estimate(self, image: ndarray, K: ndarray, detections: Detections) -> Poses:
            poses = super().estimate(image, K, detections)
            poses.cam_T_obj[0, 0, 3] = np.nan
            return poses

    out = boxes.with_name("out.csv")
    with pytest.raises(FormatError, match=r"as the estimator wrote it, line 2: t is 'nan"):
        run_estimator(Broken(dataset.models), dataset, read_detections(boxes), out)
    assert not out.exists()


def test_the_verb_runs_a_command(
    python: Path, dataset: BopDataset, boxes: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = boxes.with_name("out.csv")
    assert main(verb(dataset, boxes, out, command(python), "--timeout", "60")) == 0
    printed = capsys.readouterr()
    assert printed.out == f"{out}: 6 poses in 3 images, from 6 detections in 3\n"
    assert "jittered ground truth, seed 0, not a detector" in printed.err
    assert len(read_results(out)) == 6


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
    assert "1 poses in 1 images, from 1 detections in 1" in printed.out


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


def test_progress_goes_from_image_to_image(
    dataset: BopDataset, boxes: Path, tmp_path: Path
) -> None:
    calls: list[tuple[float, str]] = []
    run_estimator(
        BoxEstimator(dataset.models),
        dataset,
        read_detections(boxes, dataset),
        tmp_path / "out.csv",
        progress=lambda share, message: calls.append((share, message)),
    )
    shares = [share for share, _ in calls]
    assert shares[0] == 0.0 and shares == sorted(shares) and shares[-1] < 1.0
    assert calls[0][1] == "image 1/3"
