"""The installed MuJoCo: files of two versions in one folder, and files that are missing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import graspcast
from graspcast.simulation.mujoco_version import installed_mujoco

LIBRARY = "libmujoco.so.4.0.0"


def install(site: Path, name: str, version: str, files: tuple[str, ...]) -> None:
    """Lay out what an installed package leaves: its files, and its record of them."""
    info = site / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    (info / "RECORD").write_text("".join(f"mujoco/{file},sha256=x,1\n" for file in files))
    for file in files:
        path = site / "mujoco" / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("mj_versionString = lambda: '4.0.0'\n" if file == "__init__.py" else "")


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A directory of packages in which MuJoCo would be found first."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "mujoco", raising=False)
    return tmp_path


def imported(site: Path) -> subprocess.CompletedProcess[str]:
    """Run a verb that simulates, with the packages of a directory first."""
    places = os.pathsep.join([str(site), str(Path(graspcast.__file__).parents[1])])
    return subprocess.run(
        [sys.executable, "-m", "graspcast", "check-gripper", "parallel"],
        env={**os.environ, "PYTHONPATH": places},
        capture_output=True,
        text=True,
    )


def test_the_one_that_the_tests_run_with_is_whole() -> None:
    installed = installed_mujoco()
    assert installed.owners
    assert not installed.problem


def test_mujoco_and_its_core_of_one_version_fit(site: Path) -> None:
    install(site, "mujoco-core", "4.0.0", ("__init__.py", LIBRARY))
    install(site, "mujoco", "4.0.0", ("__init__.py",))
    installed = installed_mujoco()
    assert installed.folder == site / "mujoco"
    assert installed.owners == {"mujoco": "4.0.0", "mujoco-core": "4.0.0"}
    assert not installed.problem


@pytest.mark.slow
def test_two_versions_in_one_folder_are_named_with_the_remedy(site: Path) -> None:
    install(site, "mujoco", "3.17.0", ("__init__.py",))
    install(site, "mujoco-core", "4.0.0", ("__init__.py", LIBRARY))
    assert "mujoco 3.17.0 and mujoco-core 4.0.0 are two versions" in installed_mujoco().problem
    run = imported(site)
    assert run.returncode == 2
    assert "mujoco 3.17.0 and mujoco-core 4.0.0 are two versions of MuJoCo" in run.stderr
    assert "pip uninstall -y mujoco mujoco-core; pip install mujoco" in run.stderr
    assert "Traceback" not in run.stderr


@pytest.mark.slow
def test_files_that_another_package_took_away_are_missed(site: Path) -> None:
    install(
        site, "mujoco-core", "4.0.0", ("__init__.py", LIBRARY, "_structs.so", "egl/__init__.py")
    )
    (site / "mujoco" / "_structs.so").unlink()
    (site / "mujoco" / "egl" / "__init__.py").unlink()
    assert "of mujoco-core 4.0.0, _structs.so and 1 more is missing" in installed_mujoco().problem
    assert imported(site).returncode == 2


@pytest.mark.slow
def test_tests_and_headers_need_not_be_there(site: Path) -> None:
    install(site, "mujoco-core", "4.0.0", ("__init__.py", "render_test.py", "include/mujoco.h"))
    (site / "mujoco" / "render_test.py").unlink()
    (site / "mujoco" / "include" / "mujoco.h").unlink()
    assert not installed_mujoco().problem


@pytest.mark.slow
def test_a_folder_that_no_package_owns(site: Path) -> None:
    (site / "mujoco").mkdir()
    (site / "mujoco" / "__init__.py").write_text("raise AttributeError('half of it')\n")
    installed = installed_mujoco()
    assert not installed.owners
    assert f"Delete {site / 'mujoco'}" in installed.remedy
    run = imported(site)
    assert run.returncode == 2
    assert "cannot be imported (half of it)" in run.stderr


@pytest.mark.slow
def test_a_package_of_another_version_than_the_library(site: Path) -> None:
    install(site, "mujoco-core", "4.0.1", ("__init__.py",))
    run = imported(site)
    assert run.returncode == 2
    assert "mujoco-core 4.0.1 is installed, but the library" in run.stderr


@pytest.mark.slow
def test_an_old_mujoco_is_refused(site: Path) -> None:
    install(site, "mujoco", "3.2.7", ("__init__.py",))
    (site / "mujoco" / "__init__.py").write_text("mj_versionString = lambda: '3.2.7'\n")
    run = imported(site)
    assert run.returncode == 2
    assert "MuJoCo 3.2.7 is installed, but graspcast needs 3.8.1 or newer" in run.stderr
