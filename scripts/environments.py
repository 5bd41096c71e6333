"""Virtual environments that the scripts make, and programs that they need."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path


def python_of(home: Path) -> Path:
    """Return the Python of a virtual environment, on any system."""
    (python,) = {*home.glob("bin/python"), *home.glob("Scripts/python.exe")}
    return python


def program(name: str) -> str:
    """Return the path of a program of the extra ``dev``; without it, end with a message."""
    found = shutil.which(name)
    if found is None:
        sys.exit(f"{name} is not installed: pip install -e '.[dev]'")
    return found
