"""The verb validate-sim."""

from __future__ import annotations

from pathlib import Path

import pytest

from commands import refused


def test_a_directory_without_the_data_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["--json", str(tmp_path / "validation.json")]
    said = refused(["validate-sim", "--data", str(tmp_path), *out], capsys)
    assert "no published/lmo/trials.csv here" in said
    assert list(tmp_path.iterdir()) == []
