"""The verb check-gripper."""

from __future__ import annotations

from pathlib import Path

import pytest

from commands import refused
from graspcast.cli import main
from graspcast.simulation.engine import mujoco
from graspcast.simulation.mujoco_version import release_of
from jaws import write_jaws

DATA = Path(__file__).parents[1] / "data"


def test_a_gripper_that_passes(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check-gripper", str(DATA / "three_jaw.toml")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith("passed")
    assert all(line.startswith("  ok ") for line in lines[1:16])
    assert lines[16] == "In simulation"
    (opening,) = (line for line in lines[17:] if "opening" in line)
    assert opening.count("90.0 mm") == 2


@pytest.mark.slow
@pytest.mark.skipif(
    release_of(mujoco.__version__) < (3, 12), reason="MuJoCo before 3.12 makes no such remark"
)
def test_a_picture_and_the_notes_of_mujoco(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_jaws(tmp_path, more='<option timestep="0.0005"/>', x=0.01)
    assert main(["check-gripper", str(path), "--picture", str(tmp_path / "jaws.png")]) == 2
    out, err = capsys.readouterr()
    assert out.splitlines()[-1] == str(tmp_path / "jaws.png")
    assert (tmp_path / "jaws.png").read_bytes().startswith(b"\x89PNG")
    assert "FAIL centred: the middle of the gap between the fingers is 10.0 mm off the TCP" in out
    assert "MuJoCo: " in err and "timestep: parent has 0.002 (default), child has 0.0005" in err
    said = refused(["check-gripper", str(path), "--picture", "jaws.pdf"], capsys)
    assert "the picture is a .png file (see --picture)" in said


def test_a_gripper_that_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A hand whose closed fingers are where the open ones are."""
    settings = (DATA / "three_jaw.toml").read_text().replace("0.06", "0.0")
    (tmp_path / "three_jaw.toml").write_text(settings)
    (tmp_path / "three_jaw.xml").write_text((DATA / "three_jaw.xml").read_text())
    path = str(tmp_path / "three_jaw.toml")
    assert main(["check-gripper", path]) == 2
    out, err = capsys.readouterr()
    assert "FAILED" in out.splitlines()[0]
    failed = [line.split()[1].rstrip(":") for line in out.splitlines() if "  FAIL " in line]
    assert failed and f"{path} does not pass: {', '.join(failed)}" in err


def test_a_gripper_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "unknown gripper 'claw'" in refused(["check-gripper", "claw"], capsys)
    said = refused(["check-gripper", str(tmp_path / "claw.toml")], capsys)
    assert "claw.toml" in said
