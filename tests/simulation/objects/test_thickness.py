"""Collision pieces that make an object thicker are said where an object is loaded."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from cad_parts import plate, tube
from graspcast.simulation.objects import thickness
from graspcast.simulation.objects.catalogue import read_catalogue
from graspcast.simulation.objects.load import load_object
from graspcast.simulation.objects.thickness import added_thickness

ENTRY = """
[objects.part]
mesh = "part.stl"
unit = "m"
mass_kg = 0.05
mass_source = "scales"
friction = 0.6
friction_source = "a guess"
up = [0, 0, 1]
collision = {collision}
"""


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GRASPCAST_CACHE", str(tmp_path / "cache"))


def load(folder: Path, collision: str) -> object:
    (folder / "objects.toml").write_text(ENTRY.replace("{collision}", collision))
    return load_object("part", catalogue=read_catalogue(folder / "objects.toml"))


def test_a_hull_that_fills_a_tube_is_said_and_kept(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    tube().export(tmp_path / "part.stl")
    target = load(tmp_path, "{ pieces = 1 }")
    # The middle of the hole of 40 mm.
    assert added_thickness(target) == pytest.approx(0.02, abs=0.003)  # type: ignore[arg-type]
    assert "object part: its collision piece reaches up to" in caplog.text
    assert "smallest side is 60" in caplog.text and "pieces = 8" in caplog.text
    # It is not measured again.
    monkeypatch.setattr(thickness, "sticks_out", lambda *_: pytest.fail("measured again"))
    caplog.clear()
    load(tmp_path, "{ pieces = 1 }")
    assert "collision piece reaches" in caplog.text
    (kept,) = (tmp_path / "cache" / "thickness").iterdir()
    kept.write_text("{}")
    monkeypatch.setattr(thickness, "sticks_out", lambda *_: 0.0)
    load(tmp_path, "{ pieces = 1 }")
    assert "is damaged" in caplog.text


def test_a_plate_that_fits_is_not(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    plate().export(tmp_path / "part.stl")
    with caplog.at_level(logging.WARNING):
        load(tmp_path, "{ pieces = 1 }")
        load(tmp_path, '{ primitives = [{ kind = "box", size_m = [0.045, 0.045, 0.0015] }] }')
    assert "reach" not in caplog.text
