"""Provenance: the versions of the software that computed something."""

from __future__ import annotations

import platform
from importlib.metadata import version

from graspcast._version import __version__

__all__ = ["versions"]


def versions(*packages: str) -> dict[str, str]:
    """Return the versions of graspcast, Python, NumPy and further installed packages."""
    return {
        "graspcast": __version__,
        "python": platform.python_version(),
        **{name: version(name) for name in ("numpy", *packages)},
    }
