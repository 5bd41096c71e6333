"""The program: usage, help, exit codes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import graspcast
from graspcast.cli import main, parser

ENV = {**os.environ, "PYTHONPATH": str(Path(graspcast.__file__).parents[1])}


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["unknown"],
        ["predict"],
        ["errors", "--bop", "x", "--estimates", "no-equals-sign"],
        ["reproduce", "--data", "x", "--seeds", "0"],
        ["predict", "--model", "m", "--out", "v", "--estimates", "a=b", "--threshold", "1.5"],
    ],
)
def test_wrong_usage_exits_with_2(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2


def test_every_verb_explains_itself() -> None:
    verbs = next(a for a in parser()._actions if a.dest == "verb").choices
    assert verbs is not None
    for name, verb in verbs.items():  # type: ignore[union-attr, attr-defined]
        assert len(verb.description) > 60, name
        undocumented = [a.dest for a in verb._actions if not a.help]
        assert not undocumented, (name, undocumented)


def test_the_program_as_a_user_starts_it(world: Path) -> None:
    def start(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "graspcast", *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=False, env=ENV)

    version = start("--version")
    assert version.stdout.strip() == f"graspcast {graspcast.__version__}"
    wrong = start("errors", "--bop", str(world / "made"), "--estimates", f"a={world / 'none.csv'}")
    assert wrong.returncode == 2
    assert wrong.stdout == ""
    assert wrong.stderr.startswith("graspcast errors: ")
    assert "Traceback" not in wrong.stderr


@pytest.mark.parametrize(
    ("error", "said"),
    [(MemoryError(), "memory ran out"), (RuntimeError("can't start new thread"), "new thread")],
)
def test_too_little_memory_is_one_line(
    error: Exception,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("graspcast.simulation.grippers.load_gripper", fail)
    # In a process, `main` discards what is left of the output; here it must not.
    monkeypatch.setattr("graspcast.cli._discard_output", lambda: None)
    assert main(["grasps", "--gripper", "parallel", "--out", str(tmp_path / "sheet.png")]) == 2
    written = capfd.readouterr().err.splitlines()
    assert written[-1].startswith("graspcast grasps: ") and said in written[-1]
