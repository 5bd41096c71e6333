"""The extra ``serve``: whether what the service needs is installed."""

from __future__ import annotations

from importlib.util import find_spec

from graspcast.errors import ExtraMissingError

__all__ = ["check_installed"]

_NEEDED = {
    "fastapi": "FastAPI",
    "httptools": "httptools",
    "prometheus_client": "prometheus-client",
    "uvicorn": "uvicorn",
}


def check_installed() -> None:
    """Raise unless all that the service needs is installed.

    Raises
    ------
    ExtraMissingError
        Naming what is missing, and how to install it.
    """
    for module, package in _NEEDED.items():
        if find_spec(module) is None:
            raise ExtraMissingError(package, "serve")
