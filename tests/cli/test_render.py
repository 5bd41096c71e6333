"""The verb render."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from graspcast.cli import main
from graspcast.simulation.engine import mujoco
from graspcast.simulation.mujoco_version import release_of
from solid_models import write_solid_models


@pytest.fixture
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_solid_models(tmp_path_factory.mktemp("solids") / "models")


def test_what_cannot_be_rendered_leaves_nothing(
    models: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    full = tmp_path / "full"
    full.mkdir()
    (full / "kept").write_text("mine")
    assert main(["render", "--models", str(models), "--out", str(full)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["render", "--models", str(tmp_path), "--out", str(tmp_path / "b")]) == 2
    assert "models_info.json" in capsys.readouterr().err
    for split in ("../out", "models", "a/b", ""):
        command = [
            "render",
            "--models",
            str(models),
            "--out",
            str(tmp_path / "c"),
            "--split",
            split,
        ]
        assert main(command) == 2
        assert "a split is a name such as test" in capsys.readouterr().err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["full"]
    assert [p.name for p in full.iterdir()] == ["kept"]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="EGL is Linux's: run it there")
@pytest.mark.skipif(
    release_of(mujoco.__version__) < (4,),
    reason="MuJoCo before 4.0 prints a traceback of its own when a context could not be opened",
)
def test_without_opengl_one_message_and_nothing_written(models: Path, tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "graspcast",
        "render",
        "--models",
        str(models),
        "--scenes",
        "1",
    ]
    source = str(Path(__file__).parents[2] / "src")
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("MUJOCO", "PYOPENGL"))}
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "out")],
        env={**clean, "PYTHONPATH": source, "MUJOCO_EGL_DEVICE_ID": "99"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2 and "libegl1" in done.stderr and "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())
