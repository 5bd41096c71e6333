"""The verb tolerance."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from commands import refused
from cubes import write_tables
from graspcast.cli import main


@pytest.fixture
def pair(tmp_path: Path) -> list[str]:
    return ["tolerance", "--object", "cube", "--gripper", "parallel", *write_tables(tmp_path)]


@pytest.mark.slow
def test_tolerance_is_printed_written_and_drawn(
    tmp_path: Path, pair: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    figures, picture = tmp_path / "tolerance.json", tmp_path / "tolerance.png"
    written = ["--json", str(figures), "--out", str(picture)]
    assert main([*pair, "--trials", "8", "--deviations", "1", "3", "2", *written]) == 0
    said, err = capsys.readouterr()
    assert "at the true pose 8 of 8 succeed" in said
    assert "along the closing direction" in said
    assert "times the given standard deviations" in said
    assert "1 mm across and 3 mm along the viewing ray, and 2°" in err
    content = json.loads(figures.read_text())
    reaches = {(r["kind"], r["axis"], r["sign"]): r for r in content["reaches"]}
    # The jaws open to 80 mm, the cube has 60 mm: a shift of 10 mm puts a finger on it.
    for sign in (-1, 1):
        assert 0.006 < reaches["shift", "closing", sign]["success_50"]["value"] < 0.014
    assert content["covariance_obj"][0][0] == pytest.approx((2 * 1e-6 + 9e-6) / 3)
    assert picture.stat().st_size > 1000


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--trials", "3"], ["3 trials", "at least 8", "--trials"]),
        (["--out", "figure.svg"], [".png"]),
        (["--covariances", "none.csv"], ["none.csv"]),
        (["--deviations", "900", "1", "1"], ["0.9 m", "--deviations"]),
        (["--deviations", "1", "1", "1", "--covariances", "a.csv"], ["exclude each other"]),
        (["--object", "cub"], ["did you mean 'cube'"]),
        (["--grasp", "left"], ["'left'", "reference"]),
    ],
)
def test_what_tolerance_cannot_do_is_said(
    pair: list[str], options: list[str], words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused([*pair, *options], capsys)
    assert all(word in said for word in words), said


def test_a_grasp_that_never_holds_is_said_to_tolerate_nothing(
    tmp_path: Path, pair: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    grasps = tmp_path / "high.toml"
    grasps.write_text(
        '[[grasp]]\nobject = "cube"\ngripper = "parallel"\nposition_m = [0.0, 0.0, 0.2]\n'
        'quaternion = [0.0, 1.0, 0.0, 0.0]\nprovenance = "of the base, not of the fingertips"\n'
    )
    assert main([*pair, "--grasps", str(grasps), "--trials", "8"]) == 0
    assert "does not even hold at the true pose" in capsys.readouterr().err
