"""The verb convert: from any form of poses to a BOP results CSV."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from graspcast.bop.results import read_results, write_results
from graspcast.cli import main
from pose_files import megapose_entries, sam6d_entries, write_json, write_matrices
from poses import random_poses, results_of

RESULTS = results_of(random_poses(3), obj_id=5, scene_id=2)
MOVE = "1 0 0 0.01 0 1 0 -0.02 0 0 1 0 0 0 0 1"


def run(*arguments: str | Path) -> int:
    return main(["convert", *map(str, arguments)])


def test_forms_of_several_estimators(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "m_kit-test.csv"
    write_results(tmp_path / "a.csv", RESULTS)
    pem = write_json(tmp_path / "detection_pem.json", sam6d_entries(RESULTS))
    matrices = write_matrices(tmp_path / "ob_in_cam", RESULTS)
    for given in (
        [tmp_path / "a.csv"],
        [pem],
        [matrices, "--scene", "2", "--object", "5"],
    ):
        assert run(*given, "--out", out) == 0
        assert_allclose(read_results(out).cam_T_obj, RESULTS.cam_T_obj, atol=1e-9)
        assert "3 poses of 1 object in 3 images" in capsys.readouterr().out
    data = write_json(tmp_path / "object_data.json", megapose_entries(RESULTS, "mug"))
    asked = [data, "--scene", "2", "--image", "7"]
    assert run(*asked, "--out", out) == 2
    assert "(see --object)" in capsys.readouterr().err
    assert run(*asked, "--object", "mug=5", "--out", out) == 0
    assert "has no scores; they become 0" in capsys.readouterr().err


def test_transforms(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given, out = tmp_path / "a.csv", tmp_path / "b.csv"
    write_results(given, RESULTS)
    moved = RESULTS.cam_T_obj.copy()
    moved[:, :3, 3] += RESULTS.cam_T_obj[:, :3, :3] @ [0.01, -0.02, 0.0]
    matrix = np.array(MOVE.split(), float).reshape(4, 4).tolist()
    path = write_json(tmp_path / "T.json", matrix)
    for T in (MOVE, f"5={MOVE}", path, f"5={path}"):
        assert run(given, "--out", out, "--apply", T) == 0
        assert_allclose(read_results(out).cam_T_obj, moved, atol=1e-12)
    out.unlink()
    for wrong, says in (
        ([f"6={MOVE}"], "a transform for object 6, but a.csv has poses of 5 (see --apply)"),
        ([MOVE.replace("0.01", "10").replace("-0.02", "0")], "is it in millimetres (10 mm)"),
        (["1 2 3"], "should be 16 finite numbers"),
        ([MOVE, MOVE], "there are two transforms for all objects"),
        (["none.json"], "none.json: cannot be read"),
    ):
        applied = [word for T in wrong for word in ("--apply", T)]
        assert run(given, "--out", out, *applied) == 2
        assert says in capsys.readouterr().err
        assert not out.exists()


def test_an_input_is_never_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.csv"
    write_results(path, RESULTS)
    before = path.read_bytes()
    (tmp_path / "link.csv").symlink_to(path)
    for out in (path, tmp_path / "link.csv"):
        assert run(path, "--out", out) == 2
        assert "is read (IN) and would be replaced (--out)" in capsys.readouterr().err
    folder = write_matrices(tmp_path / "ob_in_cam", RESULTS)
    asked = ["--scene", "2", "--object", "5"]
    assert run(folder, *asked, "--out", folder / "000001.txt") == 2
    assert "which is read; write to another file" in capsys.readouterr().err
    assert path.read_bytes() == before


def test_the_unit_is_stated_or_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = "1,2,3,0.5,1 0 0 0 1 0 0 0 1,0.01 0.02 0.9,-1\n"
    (tmp_path / "a.csv").write_text(text)
    out = tmp_path / "b.csv"
    assert run(tmp_path / "a.csv", "--out", out) == 2
    assert "is it in metres (0.90 m), not in millimetres?" in capsys.readouterr().err
    assert not out.exists()
    assert run(tmp_path / "a.csv", "--unit", "m", "--out", out) == 0
    assert read_results(out).cam_T_obj[0, 2, 3] == 0.9


def test_a_file_of_no_known_form(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.csv").write_text("x,y\n1,2\n")
    assert run(tmp_path / "a.csv", "--out", tmp_path / "b.csv") == 2
    error = capsys.readouterr().err
    assert "is in none of the forms of poses that are read" in error and "SAM-6D's JSON" in error


def test_a_file_of_transforms_of_other_objects_is_refused_for_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given, out = tmp_path / "a.csv", tmp_path / "b.csv"
    write_results(given, RESULTS)
    matrix = np.array(MOVE.split(), float).reshape(4, 4).tolist()
    path = write_json(tmp_path / "T.json", {"6": matrix})
    assert run(given, "--out", out, "--apply", f"5={path}") == 2
    assert "is of several objects, or of another one than 5" in capsys.readouterr().err
    assert not out.exists()
