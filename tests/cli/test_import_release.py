"""The verb import-release."""

from __future__ import annotations

from pathlib import Path

import pytest

from commands import refused
from graspcast.cli import main


def test_another_directory_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(["import-release", str(tmp_path), str(tmp_path / "out")], capsys)
    assert "no folder Pose-Estimates" in said


@pytest.mark.slow
def test_import_release_says_what_it_found(
    data_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    release = data_dir / "raw" / "Consensus-Driven-Uncertainty"
    assert main(["import-release", str(release), str(tmp_path / "out")]) == 0
    assert "trials 10696; instances 4125, 4 of them without a pose" in capsys.readouterr().out
