"""Choice of the rendering backend for MuJoCo scenes: OpenGL if it works, else software."""

from __future__ import annotations

import os
from functools import cache
from typing import Any, Protocol, runtime_checkable

from jaxtyping import UInt8
from numpy import ndarray

from graspcast.errors import ExtraMissingError, InputError
from graspcast.rendering.opengl_context import backend, disabled, open_context

__all__ = ["Drawer", "open_drawer", "why_software"]


@runtime_checkable
class Drawer(Protocol):
    """A renderer of one MuJoCo model, with a fixed image size."""

    def draw(self, scene: Any) -> UInt8[ndarray, "h w 3"]:
        """Render an ``MjvScene`` that has been updated."""
        ...

    def close(self) -> None:
        """Free resources held outside Python."""
        ...


def open_drawer(model: Any, width: int, height: int) -> Drawer:
    """Create a renderer for scenes of a model (``MjModel``), with the image's size in pixels.

    Raises
    ------
    InputError
        If ``MUJOCO_GL`` names no backend.
    """
    if why_software() is None:
        from graspcast.rendering.opengl import OpenGLDrawer

        return OpenGLDrawer(model, width, height)
    from graspcast.rendering.software import SoftwareDrawer

    return SoftwareDrawer(model, width, height)


def why_software() -> str | None:
    """Explain why OpenGL cannot be used here, and how to get it; None if it can.

    Raises
    ------
    InputError
        If ``MUJOCO_GL`` names no backend.
    """
    return _tried(os.environ.get("MUJOCO_GL", ""))


@cache
def _tried(named: str) -> str | None:
    if disabled():
        return f"the environment variable MUJOCO_GL is {named!r}"
    backend()
    try:
        open_context(16, 16).free()
    except (ExtraMissingError, InputError) as error:
        return str(error)
    return None
