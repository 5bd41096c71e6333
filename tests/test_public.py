"""The public API: everything in it exists, and importing it is cheap."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys
from pathlib import Path

import pytest

import graspcast

ENV = {**os.environ, "PYTHONPATH": str(Path(graspcast.__file__).parents[1])}


def test_everything_public_is_there_and_documented() -> None:
    for name in graspcast.__all__:
        value = getattr(graspcast, name)
        if name != "__version__":
            assert inspect.getdoc(value), name
    assert dir(graspcast) == sorted(graspcast.__all__)


def test_names_for_type_checkers_are_those_at_run_time() -> None:
    source = inspect.getsource(graspcast)
    block = source[source.index("if TYPE_CHECKING:") : source.index("_HOME")]
    named = set()
    for line in block.replace("(", " ").replace(")", " ").splitlines()[1:]:
        named |= set(line.rpartition("import ")[2].replace(",", " ").split())
    assert named == set(graspcast.__all__) - {"__version__"}


def test_unknown_names_are_refused() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        graspcast.nothing  # noqa: B018


def test_importing_loads_nothing_heavy() -> None:
    heavy = ["numpy", "scipy", "sklearn", "polars", "numba", "mujoco", "trimesh", "rich"]
    code = f"import sys, graspcast, graspcast.cli; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=ENV
    )
    assert done.stdout.strip() == "[]"
