"""The verb reproduce."""

from __future__ import annotations

from pathlib import Path

import pytest

from commands import refused


def test_a_directory_without_the_data_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(["reproduce", "--data", str(tmp_path)], capsys)
    assert "no published/lmo/trials.csv here" in said
