"""Off-screen OpenGL contexts."""

from __future__ import annotations

import os
import platform
from typing import Any

from graspcast.errors import ExtraMissingError, InputError

__all__ = ["backend", "disabled", "open_context"]

_BACKENDS = ("egl", "osmesa", "glfw")
_NONE = ("disable", "disabled", "off", "false", "0")  # as MuJoCo spells them


def disabled() -> bool:
    """Return whether ``MUJOCO_GL`` disables OpenGL."""
    return os.environ.get("MUJOCO_GL", "").strip().lower() in _NONE


def backend() -> str:
    """Return the OpenGL backend: on Linux ``MUJOCO_GL`` or EGL; elsewhere ``""``, MuJoCo's own.

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
            f"the environment variable MUJOCO_GL is {name!r}, which is not a backend; "
            f"unset it, or set it to one of {', '.join(_BACKENDS)}"
        )
    return name


def open_context(width: int, height: int) -> Any:
    """Open an OpenGL context and make it current, with EGL or the backend in ``MUJOCO_GL``.

    Raises
    ------
    ExtraMissingError
        If PyOpenGL is not installed, or GLFW if that is the backend.
    InputError
        If OpenGL does not work; the message says what to install.
    """
    from graspcast.simulation.engine import mujoco  # the first import of MuJoCo is checked

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
        _check_renderer(mujoco)
    except Exception as error:  # backends and drivers raise many types
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


def _check_renderer(mujoco: Any) -> None:
    """Create and free a renderer; MuJoCo raises if the context is unusable."""
    smallest = mujoco.MjModel.from_xml_string("<mujoco/>")
    mujoco.MjrContext(smallest, mujoco.mjtFontScale.mjFONTSCALE_50).free()
