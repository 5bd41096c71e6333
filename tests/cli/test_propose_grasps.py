"""The verb propose-grasps."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from commands import refused
from cubes import write_tables
from graspcast.cli import main
from graspcast.simulation.grasps.table import grasps_in


def _command(folder: Path, *more: str) -> list[str]:
    out = ["--out", str(folder / "found.toml"), "--budget", "0.05", "--count", "3"]
    tables = write_tables(folder)
    return ["propose-grasps", "--object", "cube", "--gripper", "parallel", *tables, *out, *more]


@pytest.mark.slow
def test_grasps_are_written_with_their_figures_and_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from PIL import Image

    more = ["--deviations", "3", "6", "4", "--json", str(tmp_path / "found.json")]
    more += ["--picture", str(tmp_path / "found.png")]
    assert main(_command(tmp_path, *more)) == 0
    out, err = capsys.readouterr()
    assert "success under error" in out and "reference" in out
    assert "pose errors: Student's t" in err and "3 mm across" in err
    assert "symmetry of the shape" in err
    found = grasps_in(tmp_path / "found.toml")
    names = [r.grasp.name for r in found]
    assert "reference" in names and "g01" in names
    reference = found[names.index("reference")]
    assert reference.provenance == "by a test" and "success_under_error" in reference.agreement
    told = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    assert [g["name"] for g in told["grasps"]] == names and told["trials"] > 20
    with Image.open(tmp_path / "found.png") as picture:
        assert picture.width > len(names) * 300


@pytest.mark.slow
def test_grasps_of_a_file_are_tried_and_a_wrong_frame_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    poses = []
    for depth in (0.018, 0.022, 0.026):
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[2, 3] = 0.03 - depth + 0.1034
        poses.append(pose.tolist())
    file = tmp_path / "cube.json"
    file.write_text(json.dumps({"grasps": {"transforms": poses}}), encoding="utf-8")
    said = refused(_command(tmp_path, "--from", str(file), "--frame", "tcp"), capsys)
    assert "none of 3 grasps touches" in said and "3 hold" in said and "(see --frame)" in said
    assert not (tmp_path / "found.toml").exists()
    assert main(_command(tmp_path, "--from", str(file))) == 0
    found = grasps_in(tmp_path / "found.toml")
    others = [r for r in found if r.grasp.name != "reference"]
    assert others and all("imported, grasp" in r.provenance for r in others)
    assert "GraspGen's frame" in capsys.readouterr().err


@pytest.mark.slow
def test_other_pairs_in_the_file_stay(tmp_path: Path) -> None:
    from cubes import ReferenceGrasp, write_grasps
    from graspcast.simulation.objects.types import Grasp

    other = ReferenceGrasp(Grasp(np.eye(4), "mug-1", "parallel"), "kept")
    write_grasps(tmp_path / "found.toml", [other])
    assert main(_command(tmp_path)) == 0
    found = grasps_in(tmp_path / "found.toml")
    assert {r.grasp.object for r in found} == {"cube", "mug-1"}


def test_a_file_that_cannot_be_added_to_is_found_before_the_search(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "found.toml").write_text("[[grasp]]\nobject = 3\n")
    said = refused(_command(tmp_path, "--from", str(tmp_path / "no.json")), capsys)
    assert "found.toml, grasp[0]: object should be text" in said


def test_what_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "a .png file" in refused(_command(tmp_path, "--picture", "a.jpg"), capsys)
    said = refused(_command(tmp_path, "--unit", "mm"), capsys)
    assert "name the file" in said and "--from" in said
    said = refused(_command(tmp_path, "--from", str(tmp_path / "a.yaml")), capsys)
    assert "write a YAML file as JSON" in said
    with pytest.raises(SystemExit):
        main(_command(tmp_path, "--budget", "0"))
