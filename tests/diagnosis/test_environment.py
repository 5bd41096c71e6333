"""The environment."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

import pytest

from graspcast.diagnosis import environment
from graspcast.diagnosis.environment import environment_findings


def test_two_packages_of_mujoco(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        metadata, "packages_distributions", lambda: {"mujoco": ["mujoco", "mujoco-core"]}
    )
    monkeypatch.setattr(metadata, "version", lambda name: "3.0")
    found = {f.code: f for f in environment_findings()}
    assert "mujoco 3.0 and mujoco-core 3.0" in found["two-mujoco"].message


def test_directories_that_cannot_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environment, "_writable", lambda path: False)
    assert {"numba-cache", "cache"} <= {f.code for f in environment_findings()}


def test_drawing_in_software_is_noted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("MUJOCO_GL", "off")
    (finding,) = (f for f in environment_findings() if f.code == "no-opengl")
    assert finding.severity == "note"
