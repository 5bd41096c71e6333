"""Models of three solids; skips where OpenGL does not work."""

from __future__ import annotations

from contextlib import suppress

import pytest

from graspcast.errors import GraspcastError
from graspcast.rendering.opengl_context import open_context
from graspcast.training.objects import Objects
from solid_models import write_solid_models

with suppress(ImportError):
    import torch

    # Several threads on cores that others use wait for each other.
    torch.set_num_threads(1)


@pytest.fixture(scope="session")
def solids(tmp_path_factory: pytest.TempPathFactory) -> Objects:
    """Two solids of a dataset called toy."""
    try:
        open_context(8, 8).free()
    except GraspcastError as error:
        pytest.skip(f"no OpenGL here ({error}): apt-get install libegl1 or libosmesa6")
    folder = write_solid_models(tmp_path_factory.mktemp("data") / "toy" / "models")
    return Objects.read(folder, [1, 4])
