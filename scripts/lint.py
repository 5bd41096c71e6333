"""Lint: ruff, strict types, layers, and the workflows in .github.

python scripts/lint.py
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from environments import program

ROOT = Path(__file__).parents[1]


def main() -> int:
    commands = [
        ["ruff", "check", "."],
        ["ruff", "format", "--check", "."],
        ["mypy"],
        ["lint-imports"],
        _schema("workflows", "workflows/*.yml"),
        _schema("issue-forms", "ISSUE_TEMPLATE/[!c]*.yml"),
        _schema("issue-config", "ISSUE_TEMPLATE/config.yml"),
    ]
    if shutil.which("actionlint"):  # a program of its own, not installed by pip everywhere
        commands.append(["actionlint"])
    else:
        print("without actionlint, workflows are checked by their schema alone", flush=True)
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
    failed = []
    for command in commands:
        print(f"\n== {' '.join(command)}", flush=True)
        if subprocess.run(
            [program(command[0]), *command[1:]], cwd=ROOT, env=environment
        ).returncode:
            failed.append(Path(command[0]).stem)
    if failed:
        print(f"\nfailed: {', '.join(failed)}")
    return 1 if failed else 0


def _schema(kind: str, pattern: str) -> list[str]:
    """Return the command that checks files in .github by a schema that check-jsonschema brings."""
    files = sorted(str(path.relative_to(ROOT)) for path in (ROOT / ".github").glob(pattern))
    return ["check-jsonschema", "--builtin-schema", f"vendor.github-{kind}", *files]


if __name__ == "__main__":
    sys.exit(main())
