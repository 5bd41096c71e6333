from __future__ import annotations

from pathlib import Path

import pytest
import trimesh

from mug import MUG


@pytest.fixture
def mug(tmp_path: Path) -> Path:
    trimesh.creation.cylinder(radius=35, height=90).export(tmp_path / "mug.stl")
    (tmp_path / "mine.toml").write_text(MUG)
    return tmp_path / "mine.toml"
