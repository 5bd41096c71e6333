"""External estimators, as real processes of another virtual environment."""

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
from threading import Thread

import numpy as np
import pytest
from numpy.testing import assert_allclose

import graspcast
from bop_images import IMAGES, box, write_boxes
from crude import command, left_behind, run, verb
from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import read_detections
from graspcast.bop.results import read_results
from graspcast.errors import (
    EstimatorFailedError,
    FormatError,
    GraspcastError,
    InputError,
    UnknownNameError,
)
from graspcast.perception.external import command_line, run_command
from graspcast.perception.run import run_external

GUIDE = Path(__file__).parents[2] / "docs" / "estimators.md"
ENV = {**os.environ, "PYTHONPATH": str(Path(graspcast.__file__).parents[1])}
posix = pytest.mark.skipif(
    os.name != "posix", reason="signals and process groups are POSIX: run it on Linux or macOS"
)


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
    assert np.array_equal(again.cam_T_obj, results.cam_T_obj)
    truth = dataset.ground_truth
    assert_allclose(again.cam_T_obj[:, :3, 3], truth.cam_T_obj[:, :3, 3], atol=0.25)
    assert left_behind(out.parent) == [out.name]


def test_the_example_of_the_guide(python: Path, dataset: BopDataset, boxes: Path) -> None:
    example = re.findall(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)[0]
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
            "failed with exit code 3; the last lines .*\n  CUDA error: no dev",
        ),
        ("raise", EstimatorFailedError, r"exit code 1(.|\n)*RuntimeError: weights.pth is missing$"),
        ("silent", EstimatorFailedError, "exited with code 0, but has not written its {out}"),
        ("headers", FormatError, "holds no pose$"),
        ("half", FormatError, r"out.csv, as the estimator wrote it, line 7: "),
        ("metres", FormatError, "not in millimetres"),
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
    """An estimator that ignores its detections; or one that was never given them."""
    out = tmp_path / "out.csv"
    run(python, dataset, boxes, tmp_path / "all.csv")
    some = read_detections(write_boxes(tmp_path / "some.json", box(1, 8), box(2, 3)), dataset)
    copy = (
        f"{shlex.quote(str(python))} -c 'import shutil, sys; shutil.copy(sys.argv[1], sys.argv[2])'"
    )
    whole = shlex.quote(str(tmp_path / "all.csv"))
    with pytest.raises(
        FormatError, match=r"image 1/3 has no detection; images with detections are 1/8, 2/3"
    ):
        run_external(f"{copy} {whole} {{out}} {{detections}}", dataset, some, out)
    assert not out.exists()
    kept = run_external(f"{copy} {whole} {{out}} {{detections}}", dataset, some, out, lenient=True)
    assert (len(kept), dict(kept.dropped)) == (4, {"image without detections": 2})
    assert len(read_results(out)) == 4
    assert len(run_external(f"{copy} {whole} {{out}}", dataset, some, out)) == 6


def test_placeholders_are_counted(python: Path, dataset: BopDataset, boxes: Path) -> None:
    results = run(python, dataset, boxes, boxes.with_name("out.csv"), "nothing")
    assert results.dropped == {"placeholder": 1}


@posix
@pytest.mark.slow
@pytest.mark.parametrize("how", ["hang", "deaf"])
def test_a_command_that_hangs_is_ended_with_its_children(
    python: Path, dataset: BopDataset, boxes: Path, how: str
) -> None:
    """Deaf ones ignore being asked to end."""
    folder, note = boxes.parent / "results", boxes.with_name("note.json")
    with pytest.raises(EstimatorFailedError, match="timed out after 3 s") as caught:
        run(python, dataset, boxes, folder / "out.csv", how, note, timeout_s=3.0)
    said = json.loads(note.read_text())
    assert ends(said["child"])
    assert not Path(said["out"]).exists()
    assert left_behind(folder) == []
    assert "estimating image 1 of 2" in str(caught.value)


@pytest.mark.slow
@posix
def test_what_a_command_leaves_running_is_ended(
    python: Path, dataset: BopDataset, boxes: Path
) -> None:
    out, note = boxes.with_name("out.csv"), boxes.with_name("note.json")
    lines: list[str] = []
    assert (
        len(
            run(
                python,
                dataset,
                boxes,
                out,
                "leave",
                note,
                progress=lambda _, line: lines.append(line),
            )
        )
        == 6
    )
    assert ends(json.loads(note.read_text())["child"])
    assert lines == ["estimating image 1 of 2"]


@pytest.mark.slow
@posix
@pytest.mark.parametrize(
    ("number", "code", "says"),
    [(signal.SIGINT, 130, "graspcast estimate: interrupted"), (signal.SIGTERM, 143, "")],
)
def test_ctrl_c_ends_the_command(
    python: Path, dataset: BopDataset, boxes: Path, number: int, code: int, says: str
) -> None:
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
        process.send_signal(number)
        printed, complained = process.communicate(timeout=60)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == code
    assert says in complained
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
    with pytest.raises(EstimatorFailedError, match="was killed by signal 9"):
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
        on_output=lines.append,
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
    with pytest.raises(InputError, match=r"has no {out}, the file to which"):
        command_line("run {bop}", paths)
    with pytest.raises(InputError, match="is not a command: No closing quotation"):
        command_line("run 'a {out}", paths)
    with pytest.raises(
        UnknownNameError, match=r"unknown placeholder '{image}'.*known: {bop}, {det"
    ):
        command_line("run {image} {out}", paths)


def test_an_out_that_cannot_be_written(python: Path, dataset: BopDataset, boxes: Path) -> None:
    with pytest.raises(InputError, match="is a directory, not a file"):
        run(python, dataset, boxes, boxes.parent)
    with pytest.raises(InputError, match="cannot be written"):
        run(python, dataset, boxes, boxes / "out.csv")


def test_a_command_that_no_system_takes() -> None:
    with pytest.raises(EstimatorFailedError, match=r"cannot be started \(embedded null byte\)"):
        run_command([sys.executable, "-c", "print('\0')"])


def test_a_command_may_be_run_by_any_thread() -> None:
    lines: list[str] = []
    command = [sys.executable, "-c", "print('one\\n\\n  \\ntwo')"]
    thread = Thread(target=run_command, args=(command,), kwargs={"on_output": lines.append})
    thread.start()
    thread.join(60)
    assert lines == ["one", "two"], "empty lines say nothing"


def test_a_command_that_takes_too_long() -> None:
    with pytest.raises(EstimatorFailedError, match=r"timed out after 0\.2 s") as caught:
        run_command([sys.executable, "-c", "import time; time.sleep(60)"], timeout_s=0.2)
    assert caught.value.parameters == ("timeout_s",)
