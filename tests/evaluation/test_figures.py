"""Figures are drawn: as SVG and PNG, not blank, with every method's name and figure."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from graspcast.errors import ExtraMissingError, InputError
from graspcast.evaluation.bootstrap import Bootstrap
from graspcast.evaluation.figures import draw_figures, reliability_diagram
from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.scores import calibration_error, risk_coverage

METHODS = ("threshold", "good")
HOW = Bootstrap(draws=20)


def forecasts(method: str, gripper: str) -> Forecasts:
    rng = np.random.default_rng(len(gripper))
    chance = rng.random(400)
    success = rng.random(400) < chance
    probability = np.round(chance) if method == "threshold" else chance
    scenes = np.array([f"d/{i // 40}" for i in range(400)])
    return Forecasts(
        "unseen_scenes", method, "a", gripper, probability, success, np.full(400, "d-1"), scenes
    )


@pytest.fixture(scope="module")
def every() -> list[Forecasts]:
    return [forecasts(m, g) for m in METHODS for g in ("parallel", "underactuated")]


def words(svg: Path) -> str:
    """matplotlib draws letters as paths, and says what they spell in comments."""
    return " ".join(re.findall(r"<!-- (.*?) -->", svg.read_text()))


@pytest.fixture(scope="module")
def drawn(every: list[Forecasts], tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    pytest.importorskip("matplotlib", reason="needs Matplotlib: pip install 'graspcast[plot]'")
    return draw_figures(every, tmp_path_factory.mktemp("drawn"), methods=METHODS, bootstrap=HOW)


@pytest.mark.slow
def test_figures_are_drawn_and_say_what_they_show(
    every: list[Forecasts], drawn: list[Path]
) -> None:
    paths = drawn
    assert sorted(p.name for p in paths[0].parent.iterdir()) == [
        "reliability.png",
        "reliability.svg",
        "risk_coverage.png",
        "risk_coverage.svg",
    ]
    reliability, risk = map(words, paths)
    for f in every:
        assert f"{f.gripper} gripper" in reliability
        assert f"{f.gripper} gripper" in risk
        assert f.method in reliability
        assert f"ECE {calibration_error(f.probability, f.success):.3f}" in reliability
        assert f"{f.method}  {risk_coverage(f.probability, f.success).area:.3f}" in risk
    for path in paths:
        with Image.open(path.with_suffix(".png")) as picture:
            pixels = np.asarray(picture.convert("RGB"))
        assert pixels.shape[0] > 400
        inked = (pixels.max(axis=2).astype(int) - pixels.min(axis=2) > 60).mean()
        assert 0.001 < inked < 0.5  # coloured, but mostly white
        assert (pixels == 255).all(axis=2).mean() > 0.5


@pytest.mark.slow
def test_the_same_forecasts_give_the_same_bytes(
    every: list[Forecasts], drawn: list[Path], tmp_path: Path
) -> None:
    draw_figures(every, tmp_path, methods=METHODS, bootstrap=HOW)
    for path in drawn[0].parent.iterdir():
        assert path.read_bytes() == (tmp_path / path.name).read_bytes(), path.name


def test_nothing_to_draw(every: list[Forecasts], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no forecasts of nobody in unseen_scenes to draw"):
        reliability_diagram(every, tmp_path / "a.svg", methods=["nobody"])


def test_without_matplotlib(
    every: list[Forecasts], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ExtraMissingError, match=r"pip install 'graspcast\[plot\]'"):
        draw_figures(every, tmp_path, methods=METHODS)
    assert list(tmp_path.iterdir()) == []
