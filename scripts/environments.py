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
    """Return the path of a program of the extra ``dev``; without it, end with a message.

    It is looked for beside Python first, so that no environment has to be activated.
    """
    found = shutil.which(name, path=str(Path(sys.executable).parent)) or shutil.which(name)
    if found is None:
        sys.exit(f"{name} is not installed: pip install -e '.[dev]'")
    return found
