"""The extra ``fetch``: httpx, imported when something is downloaded."""

from __future__ import annotations

from types import ModuleType

from graspcast.errors import ExtraMissingError

__all__ = ["import_httpx"]


def import_httpx() -> ModuleType:
    """Import httpx.

    Raises
    ------
    ExtraMissingError
        If it is not installed.
    """
    try:
        import httpx
    except ImportError as error:
        raise ExtraMissingError("httpx", "fetch") from error
    return httpx
