"""OpenGL without a display. Nothing here imports MuJoCo before its backend is chosen."""

from __future__ import annotations

import os
import platform
from typing import Any

from graspcast.errors import ExtraMissingError, InputError

__all__ = ["choose_gl", "open_context"]

_BACKENDS = ("egl", "osmesa", "glfw")


def choose_gl() -> str:
    """Have MuJoCo draw without a display, unless the user has set ``MUJOCO_GL``.

    Call it before ``mujoco`` is imported: it refuses to be imported with a value it does not know.

    Returns:
        The backend on Linux, ``""`` elsewhere, where MuJoCo has its own.

    Raises:
        InputError: for a value of ``MUJOCO_GL`` that no picture can be drawn with.
    """
    if platform.system() != "Linux":
        return ""
    name = os.environ.get("MUJOCO_GL", "").strip().lower()
    if not name:
        name = os.environ["MUJOCO_GL"] = "egl"
    if name not in _BACKENDS:
        raise InputError(
            f"the environment variable MUJOCO_GL is {name!r}, with which no picture can be drawn; "
            f"unset it, or set it to one of {', '.join(_BACKENDS)}"
        )
    return name


def open_context(width: int, height: int) -> Any:
    """An OpenGL context that is current.

    The backend is imported here, whatever MuJoCo has chosen when it was imported, which may have
    been before :func:`choose_gl`.
    """
    name = choose_gl()
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
            f"cannot draw: OpenGL{' by ' + name.upper() if name else ''} does not work here "
            f"({type(error).__name__}: {error}); {remedy}"
        ) from error
    return context
