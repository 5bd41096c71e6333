"""External estimators as real processes of another virtual environment, and the image loop."""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from numpy import ndarray
from numpy.testing import assert_allclose

import graspcast
from bop_images import FOCAL, IMAGES, SIZE, box, write_boxes, write_dataset, write_image
from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import Detections, jittered, read_detections, write_detections
from graspcast.bop.models import Models
from graspcast.bop.results import read_results
from graspcast.cli import main
from graspcast.errors import (
    EstimatorFailedError,
    FormatError,
    GraspcastError,
    InputError,
    UnknownNameError,
)
from graspcast.geometry import transform
from graspcast.perception.estimator import Poses
from graspcast.perception.external import command_line, run_command
from graspcast.perception.run import run_estimator, run_external

SCRIPT = Path(__file__).with_name("foreign_estimator.py")
GUIDE = Path(__file__).parents[2] / "docs" / "estimators.md"
ENV = {**os.environ, "PYTHONPATH": str(Path(graspcast.__file__).parents[1])}
posix = pytest.mark.skipif(os.name != "posix", reason="signals and process groups are POSIX")


@pytest.fixture(scope="session")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of another virtual environment, which has no package at all."""
    folder = tmp_path_factory.mktemp("other env")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


@pytest.fixture
def dataset(tmp_path: Path) -> BopDataset:
    return write_dataset(tmp_path / "made")


@pytest.fixture
def boxes(dataset: BopDataset, tmp_path: Path) -> Path:
    path = tmp_path / "my boxes.json"
    write_detections(path, jittered(dataset, 0))
    return path


def command(python: Path, *words: object) -> str:
    out = [shlex.quote(str(python)), shlex.quote(str(SCRIPT)), "{bop} {detections} {out}"]
    return " ".join([*out, *(shlex.quote(str(word)) for word in words)])


def run(
    python: Path, dataset: BopDataset, boxes: Path, out: Path, *words: object, **options: object
) -> object:
    detections = read_detections(boxes, dataset)
    template = command(python, *words)
    return run_external(template, dataset, detections, out, **options)  # type: ignore[arg-type]


def left_behind(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def is_running(pid: int) -> bool:
    """Whether a process is there and no zombie, which only its parent can remove."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    stat = Path(f"/proc/{pid}/stat")
    return not (stat.exists() and stat.read_text().rpartition(")")[2].split()[0] == "Z")


def ends(pid: int, within_s: float = 10.0) -> bool:
    deadline = time.monotonic() + within_s
    while is_running(pid) and time.monotonic() < deadline:
        time.sleep(0.02)
    return not is_running(pid)


def test_a_command_in_another_environment(
    python: Path, dataset: BopDataset, boxes: Path, tmp_path: Path
) -> None:
    out, note = tmp_path / "results" / "crude_made-test.csv", tmp_path / "note.json"
    results = run(python, dataset, boxes, out, "environment", note)
    said = json.loads(note.read_text())
    assert Path(said["prefix"]) == python.parents[1]
    assert Path(said["prefix"]) != Path(sys.prefix)
    assert said["argv"][:2] == [str(dataset.root.resolve()), str(boxes.resolve())]
    assert Path(said["argv"][2]).name == out.name
    again = read_results(out)
    assert len(again) == len(read_detections(boxes)) == 2 * len(IMAGES)
    assert np.array_equal(again.cam_T_obj, results.cam_T_obj)  # type: ignore[attr-defined]
    truth = dataset.ground_truth
    assert_allclose(again.cam_T_obj[:, :3, 3], truth.cam_T_obj[:, :3, 3], atol=0.25)
    assert left_behind(out.parent) == [out.name]


def test_the_example_of_the_guide(python: Path, dataset: BopDataset, boxes: Path) -> None:
    (example,) = re.findall(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)
    script = boxes.with_name("estimate.py")
    script.write_text(example)
    template = (
        f"{shlex.quote(str(python))} {shlex.quote(str(script))} {{bop}} {{detections}} {{out}}"
    )
    out = boxes.with_name("guide.csv")
    run_external(template, dataset, read_detections(boxes), out)
    reference = boxes.with_name("reference.csv")
    run(python, dataset, boxes, reference)
    assert_allclose(read_results(out).cam_T_obj, read_results(reference).cam_T_obj)


@pytest.mark.parametrize(
    ("how", "error", "says"),
    [
        (
            "fail",
            EstimatorFailedError,
            "failed with exit code 3; the last .*\n  CUDA error: no dev",
        ),
        ("raise", EstimatorFailedError, r"exit code 1(.|\n)*RuntimeError: weights.pth is missing$"),
        ("silent", EstimatorFailedError, "ended well, but has not written its {out}"),
        ("half", FormatError, r"out.csv, as the estimator wrote it, line 7: "),
        ("metres", FormatError, "t seems to be in metres"),
        ("count", FormatError, r"line 2: there is no image 1/0 in .*numbers in the files' names"),
        ("object", FormatError, r"line 2: object 2 is not in .*models_info.json, which has 1, 5"),
    ],
)
@pytest.mark.parametrize("before", [None, "what was there before"])
def test_a_command_that_goes_wrong_leaves_nothing(
    python: Path,
    dataset: BopDataset,
    boxes: Path,
    how: str,
    error: type[GraspcastError],
    says: str,
    before: str | None,
) -> None:
    folder = boxes.parent / "results"
    folder.mkdir()
    out = folder / "out.csv"
    if before:
        out.write_text(before)
    with pytest.raises(error, match=says):
        run(python, dataset, boxes, out, how)
    assert left_behind(folder) == (["out.csv"] if before else [])
    assert not before or out.read_text() == before


def test_images_without_detections_are_refused_if_the_command_was_given_some(
    python: Path, dataset: BopDataset, boxes: Path, tmp_path: Path
) -> None:
    """An estimator that ignores its detections; or one that was never told of them."""
    out = tmp_path / "out.csv"
    run(python, dataset, boxes, tmp_path / "all.csv")
    some = read_detections(write_boxes(tmp_path / "some.json", box(1, 8), box(2, 3)), dataset)
    copy = (
        f"{shlex.quote(str(python))} -c 'import shutil, sys; shutil.copy(sys.argv[1], sys.argv[2])'"
    )
    whole = shlex.quote(str(tmp_path / "all.csv"))
    with pytest.raises(
        FormatError, match=r"image 1/3 has no detection; there are some in 1/8, 2/3"
    ):
        run_external(f"{copy} {whole} {{out}} {{detections}}", dataset, some, out)
    assert not out.exists()
    kept = run_external(f"{copy} {whole} {{out}} {{detections}}", dataset, some, out, lenient=True)
    assert (len(kept), dict(kept.dropped)) == (4, {"image without detections": 2})
    assert len(read_results(out)) == 4
    assert len(run_external(f"{copy} {whole} {{out}}", dataset, some, out)) == 6


def test_placeholders_are_counted(python: Path, dataset: BopDataset, boxes: Path) -> None:
    results = run(python, dataset, boxes, boxes.with_name("out.csv"), "nothing")
    assert results.dropped == {"placeholder": 6}  # type: ignore[attr-defined]


@posix
@pytest.mark.slow
@pytest.mark.parametrize("how", ["hang", "deaf"])
def test_a_command_that_hangs_is_ended_with_its_children(
    python: Path, dataset: BopDataset, boxes: Path, how: str
) -> None:
    """Deaf ones ignore being asked to end."""
    folder, note = boxes.parent / "results", boxes.with_name("note.json")
    with pytest.raises(
        EstimatorFailedError, match="took longer than the 5 s of --timeout"
    ) as caught:
        run(python, dataset, boxes, folder / "out.csv", how, note, timeout_s=5.0)
    said = json.loads(note.read_text())
    assert ends(said["child"])
    assert not Path(said["out"]).exists()
    assert left_behind(folder) == []
    assert "estimating image 1 of 2" in str(caught.value)


@posix
def test_what_a_command_leaves_running_is_ended(
    python: Path, dataset: BopDataset, boxes: Path
) -> None:
    out, note = boxes.with_name("out.csv"), boxes.with_name("note.json")
    lines: list[str] = []
    assert len(run(python, dataset, boxes, out, "leave", note, say=lines.append)) == 6  # type: ignore[arg-type]
    assert ends(json.loads(note.read_text())["child"])
    assert lines == ["estimating image 1 of 2"]


@posix
def test_ctrl_c_ends_the_command(python: Path, dataset: BopDataset, boxes: Path) -> None:
    folder, note = boxes.parent / "results", boxes.with_name("note.json")
    arguments = verb(dataset, boxes, folder / "out.csv", command(python, "hang", note))
    process = subprocess.Popen(
        [sys.executable, "-m", "graspcast", *arguments],
        env=ENV,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        deadline = time.monotonic() + 60
        while not note.exists() and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.05)
        said = json.loads(note.read_text())
        assert is_running(said["child"])
        process.send_signal(signal.SIGINT)
        printed, complained = process.communicate(timeout=60)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == 130
    assert "graspcast estimate: interrupted" in complained
    assert "Traceback" not in complained
    assert printed == ""
    assert ends(said["child"])
    assert left_behind(folder) == []


def test_a_program_that_is_not_there(dataset: BopDataset, boxes: Path) -> None:
    with pytest.raises(EstimatorFailedError, match=r"nowhere/python .*cannot be started \(No such"):
        run(Path("nowhere/python"), dataset, boxes, boxes.with_name("out.csv"))


@posix
def test_a_command_that_is_killed() -> None:
    program = "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"
    with pytest.raises(EstimatorFailedError, match="was ended by signal 9"):
        run_command([sys.executable, "-c", program])


def test_much_output_does_not_block_and_its_end_is_quoted() -> None:
    program = "import sys\nfor i in range(20000): print('x' * 50); print(i, file=sys.stderr)\n"
    with pytest.raises(EstimatorFailedError) as caught:
        run_command([sys.executable, "-c", program + "sys.exit(1)"])
    quoted = str(caught.value).splitlines()[-15:]
    assert quoted == [f"  {i}" for i in range(19985, 20000)]
    run_command([sys.executable, "-c", program])


def test_output_that_is_no_text_is_passed_on() -> None:
    lines: list[str] = []
    run_command(
        [sys.executable, "-c", r"import sys; sys.stdout.buffer.write(b'\xff\xfe ok\n')"],
        say=lines.append,
    )
    assert lines == ["\ufffd\ufffd ok"]


def test_templates(tmp_path: Path) -> None:
    paths = {"bop": tmp_path / "a b", "detections": tmp_path / "{out}", "out": tmp_path / "o"}
    words = command_line("run 'two words' --in={bop} {detections} ${HOME} {out}", paths)
    assert words == [
        "run",
        "two words",
        f"--in={tmp_path / 'a b'}",
        str(tmp_path / "{out}"),
        "${HOME}",
        str(tmp_path / "o"),
    ]
    with pytest.raises(InputError, match=r"no {out}, the file to which"):
        command_line("run {bop}", paths)
    with pytest.raises(InputError, match="is no command: No closing quotation"):
        command_line("run 'a {out}", paths)
    with pytest.raises(
        UnknownNameError, match=r"unknown placeholder '{image}'.*known: {bop}, {det"
    ):
        command_line("run {image} {out}", paths)


class BoxEstimator:
    """Upright, where the box is, as far away as the diameter fills it; too small boxes: nothing."""

    name = "box"
    obj_ids: tuple[int, ...] = (1, 5)

    def __init__(self, models: Models):
        self.models = models
        self.calls: list[tuple[ndarray, ndarray, Detections]] = []

    def estimate(self, image: ndarray, K: ndarray, detections: Detections) -> Poses:
        self.calls.append((image, K, detections))
        time.sleep(0.01)
        side = detections.box_xywh[:, 2:].max(axis=1)
        diameter = np.array([self.models[i].diameter_m for i in detections.obj_id.tolist()])
        centre = detections.box_xywh[:, :2] + detections.box_xywh[:, 2:] / 2
        pixel = np.column_stack([centre, np.ones(len(centre))])
        ray = np.linalg.solve(K, pixel.T).T
        found = side >= 5
        depth = np.where(found, diameter * K[0, 0] / side, 0.0)
        eye = np.broadcast_to(np.eye(3), (len(side), 3, 3))
        return Poses(transform(eye, ray * depth[:, None]), np.where(found, 0.5, 0.0))


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


def verb(dataset: BopDataset, boxes: Path, out: Path, estimator: str, *more: str) -> list[str]:
    paths = ["--bop", str(dataset.root), "--detections", str(boxes), "--out", str(out)]
    return ["estimate", *paths, "--estimator", estimator, *more]


def test_the_verb_runs_a_command(
    python: Path, dataset: BopDataset, boxes: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = boxes.with_name("out.csv")
    assert main(verb(dataset, boxes, out, command(python), "--timeout", "60")) == 0
    printed = capsys.readouterr()
    assert printed.out == f"{out}: 6 poses from 6 detections in 3 images\n"
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
    assert "6 poses from 6 detections in 3 images" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("estimator", "more", "says"),
    [
        ("dens", [], r"'dens' \(did you mean 'dense'\?\); known: .*An own one is a command"),
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
    assert "1 poses from 1 detections in 1 images" in printed.out


@pytest.mark.parametrize("seconds", ["0", "-1", "nan", "inf", "soon"])
def test_the_time_out_is_a_number_of_seconds(seconds: str) -> None:
    with pytest.raises(SystemExit):
        main(["estimate", "--bop", "a", "--detections", "b", "--timeout", seconds])


def test_an_out_that_cannot_be_written(python: Path, dataset: BopDataset, boxes: Path) -> None:
    with pytest.raises(InputError, match="is a directory; --out takes a file"):
        run(python, dataset, boxes, boxes.parent)
    with pytest.raises(InputError, match="cannot be written"):
        run(python, dataset, boxes, boxes / "out.csv")
