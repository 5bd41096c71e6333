"""The verb grasps."""

from __future__ import annotations

from pathlib import Path

import pytest

from commands import refused
from cubes import write_tables
from graspcast.cli import main
from graspcast.simulation.objects.types import Grasp


@pytest.fixture
def tables(tmp_path: Path) -> list[str]:
    return write_tables(tmp_path)


def test_outcomes_are_printed_and_the_sheet_is_written(
    tmp_path: Path, tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "sheet.png"
    command = ["grasps", *tables, "--objects", "cube", "lmo-5", "--size", "100", "--out", str(out)]
    assert main(command) == 0
    said = capsys.readouterr().out
    for line in ("cube by parallel", "cube by underactuated", "lmo-5 by parallel"):
        assert line in said
    assert "held" in said and said.count("no reference grasp") + said.count("no mesh") == 3
    assert out.stat().st_size > 1000


@pytest.mark.slow
def test_a_grasp_that_collides_at_the_true_pose_is_said_to(
    tmp_path: Path, tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    from graspcast.simulation.grasps.table import ReferenceGrasp, grasps_in, write_grasps

    (reference,) = grasps_in(tmp_path / "grasps.toml")
    pose = reference.grasp.obj_T_grasp.copy()
    pose[2, 3] -= 0.06
    deep = ReferenceGrasp(Grasp(pose, "cube", "parallel"), "too deep")
    write_grasps(tmp_path / "grasps.toml", [deep])
    command = ["grasps", *tables, "--objects", "cube", "--gripper", "parallel", "--size", "100"]
    command += ["--out", str(tmp_path / "sheet.png")]
    assert main(command) == 0
    out, err = capsys.readouterr()
    assert "collided, stopped" in out
    assert "collides even with a perfect estimate: cube by parallel" in err
    assert main([*command, "--protocol", "paper"]) == 0
    out, err = capsys.readouterr()
    assert "blocked" in out and "collides" not in err


@pytest.mark.slow
def test_every_grasp_of_an_object_is_drawn(
    tmp_path: Path, tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    from graspcast.simulation.grasps.table import ReferenceGrasp, grasps_in, write_grasps

    (reference,) = grasps_in(tmp_path / "grasps.toml")
    high = reference.grasp.obj_T_grasp.copy()
    high[2, 3] += 0.2
    missing = ReferenceGrasp(Grasp(high, "cube", "parallel", "air"), "too high")
    write_grasps(tmp_path / "grasps.toml", [reference, missing])
    command = ["grasps", *tables, "--objects", "cube", "--gripper", "parallel", "--size", "100"]
    command += ["--out", str(tmp_path / "sheet.png"), "--every-grasp"]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert "cube, reference by parallel" in said and "held" in said
    assert "cube, air by parallel" in said and "missed" in said


def test_only_png_sheets_and_known_objects(
    tmp_path: Path, tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(["grasps", *tables, "--out", str(tmp_path / "sheet.jpg")], capsys)
    assert "a contact sheet is a .png file (see --out)" in said
    out = ["--out", str(tmp_path / "sheet.png")]
    said = refused(["grasps", *tables, "--objects", "cub", *out], capsys)
    assert "did you mean 'cube'" in said
