"""Mutation tests: which faults are made, and what is said of them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

pytest.importorskip("cosmic_ray", reason="pip install 'graspcast[mutation]'")

SCRIPTS = Path(__file__).parents[1] / "scripts"

MODULE = '''"""Counts what is above 1 + 1."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    LIMIT = 5 + 5

__all__ = ["above", "down"]


def above(values: list[float] | None, limit: float = 2.0) -> int | None:
    """Count what is above 2 * 1."""
    if limit < 0:
        raise ValueError(f"the limit is {limit - 1}, below 0")
    return sum(v > limit for v in values)


@cache
def down(n: int, /, *, by: int = 1) -> int:
    """Count down to 0, and return 0."""
    other: int | None = n
    while other > 0:
        other -= by
    return other
'''
TESTS = """from graspcast.toy.sums import above, down

def test_above():
    assert above([1, 2, 3]) == 1
    assert above([1, 2, 3], 1) == 2

def test_down():
    assert down(4) == 0
"""
MORE = """
import pytest

def test_limit():
    assert above([1], 0) == 1
    with pytest.raises(ValueError):
        above([1], -1)
"""


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    """A tree with a package of one module."""
    for name, text in (
        ("src/graspcast/__init__.py", ""),
        ("src/graspcast/toy/__init__.py", ""),
        ("src/graspcast/toy/sums.py", MODULE),
        ("tests/toy/test_sums.py", TESTS),
        ("pyproject.toml", '[tool.pytest.ini_options]\npythonpath = ["src"]\n'),
    ):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return tmp_path


def test_faults_are_made_where_they_change_something(
    toy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(SCRIPTS)
    from mutants import mutants_of

    found = mutants_of(toy / "src" / "graspcast" / "toy" / "sums.py", "toy/sums.py")
    lines = Counter(MODULE.splitlines()[m.line - 1].strip() for m in found)
    compared = 5 + 2  # another comparison, or a number that is one off
    assert lines == {
        "def above(values: list[float] | None, limit: float = 2.0) -> int | None:": 2,
        "if limit < 0:": compared + 1,  # or the other way round
        "return sum(v > limit for v in values)": 5,
        "def down(n: int, /, *, by: int = 1) -> int:": 2,
        "while other > 0:": compared + 1,
    }
    assert len({m.key for m in found}) == len(found)
    for mutant in found:
        mutated = mutant.mutated()
        assert mutated is not None
        changed = [
            (a, b) for a, b in zip(MODULE.split("\n"), mutated.split("\n"), strict=True) if a != b
        ]
        assert len(changed) == 1
        assert f"-{changed[0][0]}\n+{changed[0][1]}" in mutant.diff(mutated)


@pytest.mark.slow
def test_survivors_are_shown_and_die_by_new_tests(toy: Path) -> None:
    """What loops for ever is stopped; a second run asks for nothing that is known."""

    def run(*more: str) -> str:
        command = [sys.executable, str(SCRIPTS / "mutation.py"), "toy", *more, f"--root={toy}"]
        command += ["--processes=2", "--patience=15", f"--results={toy / 'results.jsonl'}"]
        environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST")}
        done = subprocess.run(command, capture_output=True, text=True, env=environment)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    first = run()
    assert "25 mutants, 0 of them with a result" in first
    assert "toy/sums.py:16 survived" in first
    assert "-    if limit < 0:\n+    if limit <= 0:" in first
    results = [json.loads(line) for line in (toy / "results.jsonl").read_text().splitlines()]
    by_diff = {r["diff"]: r["outcome"] for r in results}
    (endless,) = (o for d, o in by_diff.items() if "+def down(n: int, /, *, by: int = 0)" in d)
    assert endless == "timed out"
    (killed,) = (o for d, o in by_diff.items() if "+    return sum(v < limit" in d)
    assert killed == "killed"
    with (toy / "results.jsonl").open("a") as file:
        file.write('{"key": "a run that was killed')
    again = run("toy/sums")
    assert "25 mutants, 25 of them with a result" in again
    assert again.splitlines()[-1] == first.splitlines()[-1]
    with (toy / "tests" / "toy" / "test_sums.py").open("a") as file:
        file.write(MORE)
    assert "if limit <= 0:" not in run("--again", "--sample=25")
    assert "if limit <= 0:" not in run()
    assert (toy / "src" / "graspcast" / "toy" / "sums.py").read_text() == MODULE


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["toys"], "there is no package or module 'toys'"),
        (["toy/sum"], "there is no package or module 'toy/sum'"),
        (["toy", "--processes=0"], "at least one process"),
    ],
)
def test_what_is_not_there_is_named(toy: Path, arguments: list[str], says: str) -> None:
    command = [sys.executable, str(SCRIPTS / "mutation.py"), f"--root={toy}", *arguments]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2 and says in done.stderr


@pytest.mark.slow
def test_tests_that_fail_without_a_fault_are_shown(toy: Path) -> None:
    (toy / "tests" / "toy" / "test_sums.py").write_text("def test_it():\n    assert 1 == 2\n")
    command = [sys.executable, str(SCRIPTS / "mutation.py"), "toy", f"--root={toy}"]
    command.append(f"--results={toy / 'results.jsonl'}")
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1
    assert "tests/toy fails without any mutant" in done.stderr and "1 failed" in done.stderr
