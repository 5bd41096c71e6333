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


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["watch", "--size", "640"], "WxH is needed, for example 640x480, not '640'"),
        (["watch", "--size", "641x480"], "even numbers from 64 to 4096 are needed, not '641x480'"),
        (["log", "a.db", "--since", "yesterday"], "a time as 2026-03-01 or 2026-03-01T12:00:00"),
        (["overlay", "--image", "3"], "SCENE/IMAGE is needed, for example 2/3, not '3'"),
        (["overlay", "--size", "9"], "64 to 2048 pixels are needed, not '9'"),
        (["tolerance", "--seed", "-1"], "a whole number, 0 or more, is needed, not '-1'"),
        (["convert", "a", "--object", "mug"], "NUMBER or LABEL=NUMBER is needed, not 'mug'"),
    ],
)
def test_values_of_options_that_cannot_be_read_are_named(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    said = capsys.readouterr().err
    assert f"argument {arguments[-2]}: {says}" in said


def test_a_reader_that_goes_away_ends_the_program_without_a_word(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise BrokenPipeError

    monkeypatch.setattr("graspcast.cli.fetch.print_table", broken, raising=False)
    monkeypatch.setattr("graspcast.cli.console.print_table", broken)
    assert main(["fetch", "--list"]) == 141
    assert capfd.readouterr().err == ""
