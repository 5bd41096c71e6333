"""The verb doctor."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from commands import refused
from graspcast.bop.object_transforms import read_object_transforms
from graspcast.cli import main
from graspcast.pose.transforms import invert, transform
from sick_files import healthy

D = transform(np.eye(3), np.array([0.03, -0.01, 0.05]))


def test_whole_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    healthy().write(tmp_path)
    assert main(["doctor", str(tmp_path)]) == 0
    assert capsys.readouterr().out == "0 errors, 0 warnings, 0 notes\n"


def test_an_error_is_code_1_and_the_repair_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = healthy()
    files.estimates["b"] = {i: p @ invert(D) for i, p in files.estimates["b"].items()}
    (tmp_path / "data").mkdir()
    files.write(tmp_path / "data")
    out, repairs = tmp_path / "found.json", tmp_path / "repairs.json"
    given = ["doctor", str(tmp_path / "data"), "--json", str(out), "--repairs", str(repairs)]
    assert main(given) == 1
    said = capsys.readouterr().out
    assert said.startswith("error: other-model-frame: ")
    assert "graspcast convert" in said
    content = json.loads(out.read_text())
    assert content["counts"] == {"error": 1, "warning": 0, "note": 0}
    assert content["findings"][0]["code"] == "other-model-frame"
    written = read_object_transforms(repairs)
    assert set(written) == {1, 2}
    np.testing.assert_allclose(written[1], D, atol=3e-3)
    mended = tmp_path / "mended_toy-test.csv"
    given = ["convert", str(tmp_path / "data" / "b_toy-test.csv"), "--apply", str(repairs)]
    assert main([*given, "--out", str(mended)]) == 0
    (tmp_path / "data" / "b_toy-test.csv").unlink()
    mended.rename(tmp_path / "data" / mended.name)
    assert main(["doctor", str(tmp_path / "data")]) == 0


def test_the_environment_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor"]) in (0, 1)
    assert capsys.readouterr().out.strip().endswith(("note", "notes"))


def test_misuse(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "no such file" in refused(["doctor", str(tmp_path / "nothing")], capsys)
