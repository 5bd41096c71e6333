"""OpenGL where it works, and software rendering with a reason where it does not."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cubes import orange, write_tables

SOURCE = Path(__file__).parents[2] / "src"


@pytest.fixture
def tables(tmp_path: Path) -> list[str]:
    return write_tables(tmp_path)


def watch_elsewhere(
    out: Path, tables: list[str], environment: dict[str, str], *before: str
) -> subprocess.CompletedProcess[str]:
    """Draw a strip in a process of its own, perhaps after some lines of Python."""
    command = ["watch", "--object", "cube", "--gripper", "parallel", *tables, "--out", str(out)]
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("MUJOCO", "PYOPENGL"))}
    lines = ["import sys", *before, "from graspcast.cli import main", f"sys.exit(main({command}))"]
    return subprocess.run(
        [sys.executable, "-c", "\n".join(lines)],
        capture_output=True,
        text=True,
        env=clean | {"PYTHONPATH": str(SOURCE)} | environment,
        check=False,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("environment", "words"),
    [
        ({"MUJOCO_GL": "disable"}, ["MUJOCO_GL is 'disable'"]),
        # A device that is not there is a real EGL that does not work.
        ({"MUJOCO_EGL_DEVICE_ID": "99"}, ["EGL", "OSMesa", "libegl1"]),
        # PyOpenGL is told to look elsewhere than OSMesa: the same as a library that is not there.
        ({"MUJOCO_GL": "osmesa", "PYOPENGL_PLATFORM": "egl"}, ["OSMESA", "libosmesa6", "=egl"]),
    ],
)
@pytest.mark.skipif(sys.platform != "linux", reason="EGL and OSMesa are Linux's: run it there")
def test_without_opengl_it_is_drawn_in_software_and_said_why(
    tmp_path: Path, tables: list[str], environment: dict[str, str], words: list[str]
) -> None:
    if environment != {"MUJOCO_GL": "disable"}:
        pytest.importorskip("OpenGL", reason="needs PyOpenGL: pip install 'graspcast[render]'")
    done = watch_elsewhere(tmp_path / "a.png", tables, environment)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("drawn in software") == 1
    assert all(word in done.stderr for word in words), done.stderr
    with Image.open(tmp_path / "a.png") as image:
        assert orange(np.asarray(image)) > 1000


@pytest.mark.slow
def test_without_pyopengl_it_is_drawn_in_software(tmp_path: Path, tables: list[str]) -> None:
    without = "sys.modules.update(OpenGL=None, glfw=None)"
    done = watch_elsewhere(tmp_path / "a.png", tables, {}, without)
    assert done.returncode == 0, done.stderr
    assert "drawn in software" in done.stderr and "graspcast[render]" in done.stderr
    with Image.open(tmp_path / "a.png") as image:
        assert orange(np.asarray(image)) > 1000


@pytest.mark.skipif(sys.platform != "linux", reason="EGL and OSMesa are Linux's: run it there")
def test_a_backend_that_nobody_knows_is_refused(tmp_path: Path, tables: list[str]) -> None:
    done = watch_elsewhere(tmp_path / "a.png", tables, {"MUJOCO_GL": "vulkan"})
    assert done.returncode == 2, done.stderr
    for word in ("MUJOCO_GL", "'vulkan'", "egl, osmesa"):
        assert word in done.stderr
    assert "Traceback" not in done.stderr and not list(tmp_path.glob("*.png"))
