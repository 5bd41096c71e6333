"""MuJoCo's scenes drawn by OpenGL."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from graspcast.grasping.gl import open_context

__all__ = ["OpenGLDrawer"]


class OpenGLDrawer:
    """A :class:`graspcast.grasping.drawer.Drawer` by MuJoCo's own renderer, off screen.

    Use it in one thread. The model's ``vis.global_`` states the largest picture.

    Raises:
        ExtraMissingError: if PyOpenGL is not installed.
        InputError: if there is no OpenGL to draw with.
    """

    def __init__(self, model: Any, width: int, height: int):
        self._context: Any = None
        self._mjr: Any = None
        import mujoco

        self.width, self.height = width, height
        self._context = open_context(width, height)
        self._mjr = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._mjr)

    def draw(self, scene: Any) -> UInt8[ndarray, "h w 3"]:
        """A picture of an ``MjvScene`` that has been updated."""
        import mujoco

        self._context.make_current()
        area = mujoco.MjrRect(0, 0, self.width, self.height)
        mujoco.mjr_render(area, scene, self._mjr)
        pixels = np.empty((self.height, self.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(pixels, None, area, self._mjr)
        return pixels[::-1].copy()

    def close(self) -> None:
        """Free what is held on the graphics card."""
        if self._mjr is not None:
            self._context.make_current()
            self._mjr.free()
            self._context.free()
        self._context = self._mjr = None
