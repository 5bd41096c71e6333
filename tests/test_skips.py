"""A test that is skipped says how it could run."""

from __future__ import annotations

import ast
from pathlib import Path

TESTS = Path(__file__).parent
REMEDIES = ("pip install", "run it on", "run it there")


def skips(path: Path) -> list[ast.Call]:
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text if "importorskip" in text else "")
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    return [c for c in calls if ast.unparse(c.func) in ("pytest.importorskip", "importorskip")]


def test_what_needs_a_package_says_how_to_install_it() -> None:
    for call in (call for path in TESTS.rglob("*.py") for call in skips(path)):
        (reason,) = (k.value for k in call.keywords if k.arg == "reason")
        assert any(remedy in ast.unparse(reason) for remedy in REMEDIES), ast.unparse(call)
