"""The verb watch."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from cubes import write_tables
from graspcast.cli import main


@pytest.fixture
def tables(tmp_path: Path) -> list[str]:
    return write_tables(tmp_path)


@pytest.mark.slow
def test_watch_says_the_outcome_and_draws_it(
    tmp_path: Path, tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "watch.png"
    trial = ["watch", "--object", "cube", "--gripper", "parallel", *tables, "--size", "64x64"]
    assert main([*trial, "--out", str(out)]) == 0
    assert "wooden cube" in (said := capsys.readouterr().out) and "held" in said
    assert main([*trial, "--out", str(out), "--offset", "600", "0", "0", "0", "0", "30"]) == 0
    heard = capsys.readouterr()
    assert "missed" in heard.out and "--full" in heard.err


@pytest.mark.slow
def test_a_hand_that_goes_too_deep_is_said_to_stop_short(
    tmp_path: Path, tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    trial = ["watch", "--object", "cube", "--gripper", "parallel", *tables, "--size", "64x64"]
    trial += ["--out", str(tmp_path / "watch.png"), "--offset", "0", "0", "-60", "0", "0", "0"]
    assert main(trial) == 0
    said = capsys.readouterr().out
    assert re.search(r"collided, stopped \d\d mm short, pressing the object with \d+ N", said)
    assert main([*trial, "--protocol", "paper"]) == 0
    assert "blocked" in capsys.readouterr().out
    assert main([*trial, "--contact-force", "150"]) == 0
    assert "stopped" in capsys.readouterr().out, "short of its goal, at any force"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--protocol", "paper", "--contact-force", "9", "--out", "a.png"], ["--protocol robot"]),
        (["--out", "film.avi"], [".mp4, .gif, .png"]),
        (["--gripper", "underactuated", "--out", "a.png"], ["unknown grasp", "parallel"]),
        (["--object", "cub", "--out", "a.png"], ["did you mean 'cube'"]),
        (["--image", "2/3", "--out", "a.png"], ["--estimates"]),
        (["--offset", *"00000", "nan", "--out", "a.png"], ["finite"]),
        (["--offset", "1e9", *"00000", "--out", "a.png"], ["1e+06 m off", "--offset"]),
        (["--estimates", "a=b.csv", "--out", "a.png"], ["--bop", "--image"]),
        (["--estimates", "a=b", "--offset", *"000000", "--out", "a.png"], ["exclude each other"]),
    ],
)
def test_what_watch_cannot_do_is_said(
    tables: list[str],
    options: list[str],
    words: list[str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    trial = ["watch", "--object", "cube", "--gripper", "parallel", *tables]
    assert main([*trial, *options]) == 2
    said = capsys.readouterr().err
    assert all(word in said for word in words), said


@pytest.mark.slow
def test_a_published_estimate_is_watched(
    data_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    published, bop = data_dir / "published" / "ycbv", data_dir / "bop" / "ycbv"
    with (published / "epos_ycbv-test.csv").open() as stream:
        row = next(line for line in stream if line.split(",")[2] == "4")
    scene_id, im_id, *_ = row.split(",")
    trial = [
        *("watch", "--object", "ycbv-4", "--gripper", "parallel", "--bop", str(bop)),
        *("--ground-truth", str(published / "ground_truth")),
        *("--estimates", f"epos={published / 'epos_ycbv-test.csv'}", "--size", "64x64"),
        *("--out", str(tmp_path / "strip.png")),
    ]
    assert main([*trial, "--image", f"{scene_id}/{im_id}"]) == 0
    assert (tmp_path / "strip.png").stat().st_size > 1000
    capsys.readouterr()
    assert main([*trial, "--image", "999/1"]) == 2
    assert "no estimate of ycbv-4 in image 999/1" in capsys.readouterr().err
    assert main([*trial, "--image", f"{scene_id}/{im_id}", "--est-id", "7"]) == 2
    assert "--est-id" in capsys.readouterr().err


def test_without_a_display_there_is_no_viewer(
    tables: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("platform.system", lambda: "Linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert main(["watch", "--object", "cube", "--gripper", "parallel", *tables]) == 2
    assert "no display" in (said := capsys.readouterr().err) and ".mp4, .gif or .png" in said
