"""The demonstration: whole on a few tables, by commands that do the same alone."""

from __future__ import annotations

import json
import shlex
import shutil
from pathlib import Path

import polars as pl
import pytest

from browser import check_page, started
from commands import refused
from graspcast.cli import main
from graspcast.demo_data import demo_dataset

SCENES, IMAGES = 6, 3


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first images of the first tables that ship."""
    whole, root = demo_dataset().root, tmp_path_factory.mktemp("some") / "ycbv"
    root.mkdir()
    shutil.copytree(whole / "models", root / "models")
    shutil.copyfile(whole / "camera.json", root / "camera.json")
    for scene in range(1, SCENES + 1):
        name = f"test/{scene:06d}"
        (root / name / "rgb").mkdir(parents=True)
        for image in range(IMAGES):
            shutil.copyfile(*(r / name / f"rgb/{image:06d}.webp" for r in (whole, root)))
        for file in ("scene_gt.json", "scene_gt_info.json", "scene_camera.json"):
            content = json.loads((whole / name / file).read_text())
            few = {key: value for key, value in content.items() if int(key) < IMAGES}
            (root / name / file).write_text(json.dumps(few))
    boxes = json.loads((whole / "test_detections_jittered.json").read_text())
    few = [box for box in boxes if box["scene_id"] <= SCENES and box["image_id"] < IMAGES]
    (root / "test_detections_jittered.json").write_text(json.dumps(few))
    return root


def commands(text: str) -> list[list[str]]:
    """What was printed, as a shell would run it."""
    lines = text.splitlines()
    (data,) = (line.removeprefix("DATA=") for line in lines if line.startswith("DATA="))
    (data,) = shlex.split(data)
    typed = [line.removeprefix("$ graspcast ") for line in lines if line.startswith("$ ")]
    return [shlex.split(line.replace("$DATA", data)) for line in typed]


@pytest.mark.slow
def test_the_demonstration(
    tables: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["demo", "--data", str(tables), "--out", str(out), "--threshold", "0.6"]) == 0
    text = capsys.readouterr().out
    steps = commands(text)
    verbs = [step[0] for step in steps]
    looks = 2 * ["fuse", "simulate"] + ["train"] + 3 * ["predict"]
    assert verbs[:13] == 3 * ["estimate"] + ["errors", "simulate", *looks]
    assert verbs[13:15] == ["score", "overlay"] and set(verbs[15:]) <= {"watch", "report"}
    assert "look again when in doubt" in text and "always three looks" in text
    # It judges on tables from which it has not learnt.
    verdicts = pl.read_csv(out / "verdicts3.csv")
    assert sorted(set(verdicts["scene_id"])) == [5, 6]
    assert set(verdicts["views"]) <= {1, 2, 3} and verdicts["views"].max() > 1
    assert {path.name for path in out.glob("*.png")} >= {"overlays.png"}
    # The report is of this very run: its table of policies is the one printed.
    report = out / "report.html"
    assert text.rstrip().endswith(f"Report: {report}")
    page = report.read_text()
    assert "look again when in doubt, verdicts" in page and page.count("<img") > 10
    assert "graspcast predict" in page and report.stat().st_size < 8 * 1024**2
    with started() as browser:
        check_page(browser, report)
    # Each command does alone what it did here; nothing is tried again.
    shards = {path: path.stat().st_mtime_ns for path in out.rglob("*.parquet")}
    assert len({path.parent for path in shards}) == 3
    for step in steps[3:]:
        assert main(step) == 0
    assert pl.read_csv(out / "verdicts3.csv").equals(verdicts)
    again = {path: path.stat().st_mtime_ns for path in out.rglob("*.parquet")}
    assert again == shards


def test_tables_that_will_not_do(
    tables: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["--out", str(tmp_path / "out")]
    few = tmp_path / "ycbv"
    shutil.copytree(tables, few)
    for scene in range(3, SCENES + 1):
        shutil.rmtree(few / f"test/{scene:06d}")
    said = refused(["demo", "--data", str(few), *out], capsys)
    assert "has 2 scenes, but three are needed" in said
    assert "nowhere" in refused(["demo", "--data", str(tmp_path / "nowhere"), *out], capsys)
    said = refused(["demo", "--data", str(tables), "--gripper", "claw", *out], capsys)
    assert "unknown gripper 'claw'" in said
    boxes = tables / "test_detections_jittered.json"
    moved = boxes.rename(tmp_path / "boxes.json")
    try:
        said = refused(["demo", "--data", str(tables), *out], capsys)
        assert "test_detections_jittered.json: is not there" in said
    finally:
        moved.rename(boxes)
    shutil.copytree(tables, tmp_path / "mine")
    said = refused(["demo", "--data", str(tmp_path / "mine"), *out], capsys)
    assert "no reference grasp of mine-2, mine-3" in said
    assert not (tmp_path / "out").exists()
