"""Models of three solids, and a renderer of them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from graspcast.errors import GraspcastError
from graspcast.rendering.opengl_context import open_context
from graspcast.rendering.synthetic.camera import INTRINSICS
from graspcast.rendering.synthetic.dataset import read_models
from graspcast.rendering.synthetic.renderer import Renderer
from graspcast.rendering.synthetic.tabletop import Tabletop
from solid_models import write_solid_models


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Models of three solids; skips tests where OpenGL does not work."""
    try:
        open_context(8, 8).free()
    except GraspcastError as error:
        pytest.skip(f"no OpenGL here ({error}): apt-get install libegl1 or libosmesa6")
    return write_solid_models(tmp_path_factory.mktemp("solids") / "models")


@pytest.fixture(scope="module")
def renderer(models: Path) -> Iterator[Renderer]:
    tabletop = Tabletop(read_models(models), width=1280, height=960)
    with Renderer(tabletop, INTRINSICS) as made:
        yield made
