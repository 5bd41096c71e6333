"""Optional dependencies: the modules that each extra brings, and the error where one is missing."""

from __future__ import annotations

from importlib import import_module
from typing import Final

from graspcast.errors import ExtraMissingError, InstallationError

__all__ = ["MODULES", "require"]

MODULES: Final = {
    "fetch": ("httpx",),
    "plot": ("matplotlib",),
    "ray": ("ray",),
    "render": ("glfw",),
    "rosbag": ("rosbags",),
    "serve": ("fastapi", "httptools", "prometheus_client", "uvicorn"),
    "train": ("torch", "onnx", "onnxscript"),
    "video": ("imageio_ffmpeg",),
    "view": ("viser",),
}
"""The modules that are imported by what needs an extra, by the extra's name."""


def require(extra: str) -> None:
    """Import what an extra brings, before anything is read or computed for it.

    Parameters
    ----------
    extra
        A name of :data:`MODULES`.

    Raises
    ------
    ExtraMissingError
        If a module is not installed. The message has the line that installs it.
    InstallationError
        If a module is installed, but cannot be imported.
    """
    for module in MODULES[extra]:
        package = module.replace("_", "-")
        try:
            import_module(module)
        except ModuleNotFoundError as error:
            if error.name == module:
                raise ExtraMissingError(package, extra) from error
            raise _broken(package, extra, error) from error
        except (ImportError, OSError) as error:  # a shared library of it does not load
            raise _broken(package, extra, error) from error


def _broken(package: str, extra: str, error: Exception) -> InstallationError:
    return InstallationError(
        f"{package} is installed, but cannot be imported ({error}): "
        f"pip install --force-reinstall {package}, or pip install 'graspcast[{extra}]'"
    )
