"""OpenGL without a display."""

from __future__ import annotations

import importlib
import os
import platform
import sys
from typing import Any

from graspcast.errors import ExtraMissingError, InputError

__all__ = ["backend", "disabled", "import_mujoco", "open_context"]

_BACKENDS = ("egl", "osmesa", "glfw")
_NONE = ("disable", "disabled", "off", "false", "0")  # MuJoCo's own words


def disabled() -> bool:
    """Whether ``MUJOCO_GL`` says that there shall be no OpenGL."""
    return os.environ.get("MUJOCO_GL", "").strip().lower() in _NONE


def import_mujoco() -> None:
    """Import MuJoCo, if nobody has, without its own search for OpenGL.

    On Linux that search ends the import where ``MUJOCO_GL`` names what is not there. The backend
    is for :func:`open_context` to find, when there is something to draw.
    """
    if platform.system() != "Linux" or "mujoco" in sys.modules:
        return
    before = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = "disable"
    try:
        importlib.import_module("mujoco")
    finally:
        del os.environ["MUJOCO_GL"]
        if before is not None:
            os.environ["MUJOCO_GL"] = before


def backend() -> str:
    """On Linux what ``MUJOCO_GL`` says, or EGL; elsewhere ``""``, where MuJoCo has its own.

    Raises
    ------
    InputError
        If ``MUJOCO_GL`` names no backend.
    """
    if platform.system() != "Linux":
        return ""
    name = os.environ.get("MUJOCO_GL", "").strip().lower() or "egl"
    if name not in _BACKENDS:
        raise InputError(
            f"the environment variable MUJOCO_GL is {name!r}, with which no picture can be drawn; "
            f"unset it, or set it to one of {', '.join(_BACKENDS)}"
        )
    return name


def open_context(width: int, height: int) -> Any:
    """An OpenGL context that is current: by EGL, which needs no display, or by ``MUJOCO_GL``.

    Raises
    ------
    ExtraMissingError
        If PyOpenGL is not installed, or GLFW where it is needed.
    InputError
        If there is no OpenGL to draw with; the message says what to install.
    """
    name = backend()
    try:
        if name == "egl":
            from mujoco.egl import GLContext
        elif name == "osmesa":
            from mujoco.osmesa import GLContext
        elif name == "glfw":
            from mujoco.glfw import GLContext
        else:
            from mujoco.rendering.classic.gl_context import GLContext
        context = GLContext(width, height)
        context.make_current()
        _try_to_draw()
    except Exception as error:  # each backend and driver fails in its own way
        package = getattr(error, "name", None) or ""
        if isinstance(error, ModuleNotFoundError) and package.split(".")[0] in ("OpenGL", "glfw"):
            raise ExtraMissingError(
                "glfw" if package == "glfw" else "pyopengl", "render"
            ) from error
        other = "osmesa" if name == "egl" else "egl"
        remedy = (
            f"install the system's EGL (Debian, Ubuntu: apt install libegl1 libgl1-mesa-dri) or "
            f"OSMesa (apt install libosmesa6), or try MUJOCO_GL={other}"
            if name
            else "is there a graphics driver?"
        )
        raise InputError(
            f"OpenGL{' by ' + name.upper() if name else ''} does not work here "
            f"({type(error).__name__}: {error}); {remedy}"
        ) from error
    return context


def _try_to_draw() -> None:
    """Raise what MuJoCo raises where the context is there, but nothing can be drawn with it."""
    import mujoco

    smallest = mujoco.MjModel.from_xml_string("<mujoco/>")
    mujoco.MjrContext(smallest, mujoco.mjtFontScale.mjFONTSCALE_50).free()
