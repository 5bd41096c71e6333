"""Rendering of MuJoCo scenes with OpenGL."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from graspcast.rendering.opengl_context import open_context

__all__ = ["OpenGLDrawer"]


class OpenGLDrawer:
    """A :class:`graspcast.rendering.backend.Drawer` with MuJoCo's own renderer, off screen.

    Use it in one thread. The model's ``vis.global_`` limits the image's size.

    Raises
    ------
    ExtraMissingError
        If PyOpenGL is not installed.
    InputError
        If OpenGL does not work.
    """

    def __init__(self, model: Any, width: int, height: int):
        self._context: Any = None
        self._mjr: Any = None
        from graspcast.simulation.engine import mujoco

        self.model, self.width, self.height = model, width, height
        self._context = open_context(width, height)
        self._mjr = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._mjr)

    def draw(self, scene: Any) -> UInt8[ndarray, "h w 3"]:
        """Render an ``MjvScene`` that has been updated."""
        pixels = np.empty((self.height, self.width, 3), dtype=np.uint8)
        self._read(scene, pixels, None)
        return pixels[::-1].copy()

    def draw_with_depth(
        self, scene: Any, width: int, height: int
    ) -> tuple[UInt8[ndarray, "h w 3"], Float32[ndarray, "h w"]]:
        """Render an image of at most the largest size, and OpenGL's depth buffer, from 0 to 1."""
        pixels = np.empty((height, width, 3), dtype=np.uint8)
        depth = np.empty((height, width), dtype=np.float32)
        self._read(scene, pixels, depth)
        return pixels[::-1].copy(), depth[::-1].copy()

    def upload(self, texture: int) -> None:
        """Update a texture of the model that has changed, by MuJoCo's id."""
        from graspcast.simulation.engine import mujoco

        self._context.make_current()
        mujoco.mjr_uploadTexture(self.model, self._mjr, texture)

    def _read(self, scene: Any, pixels: ndarray, depth: ndarray | None) -> None:
        """Render into arrays, whose first row is the bottom of the image."""
        from graspcast.simulation.engine import mujoco

        self._context.make_current()
        area = mujoco.MjrRect(0, 0, pixels.shape[1], pixels.shape[0])
        mujoco.mjr_render(area, scene, self._mjr)
        mujoco.mjr_readPixels(pixels, depth, area, self._mjr)

    def close(self) -> None:
        """Free the OpenGL resources."""
        if self._mjr is not None:
            self._context.make_current()
            self._mjr.free()
            self._context.free()
        self._context = self._mjr = None
