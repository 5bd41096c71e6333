"""The directory of files that can be computed again."""

from __future__ import annotations

import os
from pathlib import Path

from platformdirs import user_cache_path

__all__ = ["cache_directory"]


def cache_directory() -> Path:
    r"""Return the cache directory: ``GRASPCAST_CACHE``, or the platform's user cache.

    By default ``~/.cache/graspcast`` on Linux (``XDG_CACHE_HOME`` is respected),
    ``~/Library/Caches/graspcast`` on macOS, ``%LOCALAPPDATA%\graspcast\Cache`` on Windows.
    """
    if chosen := os.environ.get("GRASPCAST_CACHE"):
        return Path(chosen)
    return user_cache_path("graspcast", appauthor=False)
