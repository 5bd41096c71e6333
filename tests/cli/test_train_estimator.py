"""The verb train-estimator: what is wrong is said before anything is written."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from graspcast.cli import main
from graspcast.io.extras import MODULES
from solid_models import write_solid_models


@pytest.fixture
def command(tmp_path: Path) -> list[str]:
    models = write_solid_models(tmp_path / "toy" / "models")
    words = ["train-estimator", "--models", models, "--work", tmp_path / "work"]
    return [*map(str, words), "--out", str(tmp_path / "out")]


def test_without_pytorch_the_message_says_how_to_install_it(
    command: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    assert main(command) == 2
    assert "needs torch, which is not installed: pip install 'graspcast[train]'" in (
        capsys.readouterr().err
    )
    assert [p.name for p in tmp_path.iterdir()] == ["toy"]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--estimator", "dens"], "unknown estimator 'dens' (did you mean 'dense'?)"),
        (["--objects", "3"], "unknown object '3'; known: 1, 4, 7"),
        (["--strength", "7"], "from 0 to 2, not 7.0 (see --strength)"),
        (["--device", "tpu"], "unknown device 'tpu'"),
    ],
)
def test_mistakes(
    more: list[str],
    message: str,
    command: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if "--device" in more:
        pytest.importorskip("torch", reason="needs PyTorch: pip install 'graspcast[train]'")
    else:
        monkeypatch.setitem(MODULES, "train", ())
    assert main([*command, *more]) == 2
    assert message in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["toy"]
