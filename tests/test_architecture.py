"""docs/architecture.md names every module, and files and functions stay small."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "graspcast"
MODULES = sorted(p.relative_to(PACKAGE).as_posix() for p in PACKAGE.rglob("*.py"))
PAGE = (ROOT / "docs" / "architecture.md").read_text()
MOST_LINES, MOST_FUNCTION_LINES = 400, 60


def rows(heading: str) -> list[str]:
    """The first cells of the tables below a heading of the page."""
    section = PAGE[PAGE.index(f"## {heading}") :].partition("\n## ")[0]
    return re.findall(r"^\| `([^`]+)` \|", section, re.MULTILINE)


def test_the_page_names_every_module_once_and_no_other() -> None:
    named = rows("Modules")
    modules = [m for m in MODULES if not m.endswith("__init__.py") or m.count("/") == 0]
    assert sorted(named) == sorted(modules)


def test_no_loose_modules() -> None:
    top = {m for m in MODULES if "/" not in m}
    assert top == {"__init__.py", "__main__.py", "_version.py", "errors.py"}


def test_a_module_has_a_test_file_of_its_name_or_a_reason_why_not() -> None:
    tests = {p.relative_to(ROOT / "tests").as_posix() for p in (ROOT / "tests").rglob("test_*.py")}
    excused = set(rows("Modules without a test file of their own"))
    for module in MODULES:
        folder, _, name = module.rpartition("/")
        if name in ("__init__.py", "__main__.py", "_version.py"):
            continue
        mine = f"{folder}/test_{name}" if folder else f"test_{name}"
        assert (mine in tests) != (module in excused), module
    assert excused <= set(MODULES)


@pytest.mark.parametrize("module", MODULES)
def test_files_and_functions_are_small(module: str) -> None:
    """A longer function has a comment that begins with 'Long:' and says why."""
    source = (PACKAGE / module).read_text()
    lines = source.splitlines()
    assert len(lines) <= MOST_LINES
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef) and node.end_lineno is not None:
            text = "\n".join(lines[node.lineno - 1 : node.end_lineno])
            code = node.end_lineno - node.body[0].lineno + 1
            if ast.get_docstring(node) is not None and len(node.body) > 1:
                code = node.end_lineno - node.body[1].lineno + 1
            assert code <= MOST_FUNCTION_LINES or "# Long:" in text, (node.name, code)
