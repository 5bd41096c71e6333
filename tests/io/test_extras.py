"""What an extra brings is imported, or the line that installs it is told."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

import pytest

from graspcast.errors import ExtraMissingError, InstallationError
from graspcast.io.extras import MODULES, require

PROJECT = Path(__file__).parents[2] / "pyproject.toml"


def test_what_is_installed_is_imported() -> None:
    require("plot")
    assert "matplotlib" in sys.modules


@pytest.mark.parametrize("extra", MODULES)
def test_what_is_missing_is_named_with_its_remedy(
    extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = MODULES[extra][0]
    monkeypatch.setitem(sys.modules, module, None)
    name = module.replace("_", "-")
    line = re.escape(f"needs {name}, which is not installed: pip install 'graspcast[{extra}]'")
    with pytest.raises(ExtraMissingError, match=line):
        require(extra)


@pytest.mark.parametrize("text", ["import not_there_at_all", "raise ImportError('no libGL.so.1')"])
def test_what_is_broken_is_not_said_to_be_missing(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "viser.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "viser", raising=False)
    told = (
        r"viser is installed, but cannot be imported \(.*(not_there_at_all|libGL).*reinstall viser"
    )
    with pytest.raises(InstallationError, match=told):
        require("view")


def test_the_extras_are_those_of_the_project() -> None:
    extras = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    for extra, modules in MODULES.items():
        wanted = " ".join(extras[extra]).lower()
        for module in modules:
            # uvicorn[standard] brings httptools.
            assert module == "httptools" or module.replace("_", "-") in wanted, (extra, module)
