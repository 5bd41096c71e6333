"""The environment."""

from __future__ import annotations

from pathlib import Path

import pytest

from graspcast.diagnosis import environment
from graspcast.diagnosis.environment import environment_findings
from graspcast.errors import InputError, InstallationError
from graspcast.simulation.mujoco_version import InstalledMujoco


def test_a_broken_mujoco_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = InstalledMujoco(Path("there"), {"mujoco": "3.17.0"}, "files are missing")
    monkeypatch.setattr(environment, "installed_mujoco", lambda: broken)
    found = {f.code: f for f in environment_findings()}
    assert found["broken-mujoco"].severity == "error"
    assert found["broken-mujoco"].message == "files are missing"
    assert "pip install mujoco" in found["broken-mujoco"].cure


def test_no_mujoco_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    none = InstalledMujoco(None, {}, "MuJoCo is not installed")
    monkeypatch.setattr(environment, "installed_mujoco", lambda: none)
    found = {f.code: f for f in environment_findings()}
    assert found["no-mujoco"].cure == "Install it: pip install mujoco"


def test_directories_that_cannot_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environment, "_writable", lambda path: False)
    assert {"numba-cache", "cache"} <= {f.code for f in environment_findings()}


def test_drawing_in_software_is_noted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("MUJOCO_GL", "off")
    (finding,) = (f for f in environment_findings() if f.code == "no-opengl")
    assert finding.severity == "note"


def test_little_address_space_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> None:
        raise InputError("the address space is limited to 1 GB")

    monkeypatch.setattr(environment, "check_address_space", refuse)
    found = {f.code: f for f in environment_findings()}
    assert found["address-space"].severity == "error"
    assert found["address-space"].message == "the address space is limited to 1 GB"


def test_a_wrong_choice_of_opengl_is_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> str:
        raise InputError("MUJOCO_GL is 'nonsense'")

    monkeypatch.setattr("graspcast.rendering.backend.why_software", refuse)
    (finding,) = (f for f in environment_findings() if f.code == "no-opengl")
    assert (finding.severity, finding.message) == ("warning", "MUJOCO_GL is 'nonsense'")

    def broken() -> str:
        raise InstallationError("files are missing")

    monkeypatch.setattr("graspcast.rendering.backend.why_software", broken)
    assert not [f for f in environment_findings() if f.code == "no-opengl"], "said of MuJoCo"


def test_directories_that_are_to_be_made_can_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GRASPCAST_CACHE", str(tmp_path / "not" / "yet"))
    assert "cache" not in {f.code for f in environment_findings()}
    assert not (tmp_path / "not").exists()
