"""A command ends when graspcast is killed, with everything that it started."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from graspcast.perception import supervisor

pytestmark = pytest.mark.skipif(
    os.name != "posix", reason="signals and groups are POSIX: run it on Linux or macOS"
)

SOURCE = Path(__file__).parents[2] / "src"
PARENT = """
import sys
from graspcast.perception.external import run_command
run_command([sys.executable, "-S", "-c", sys.argv[1], sys.argv[2]])
"""
# A command that ignores SIGTERM, with a child that does, too.
COMMAND = """
import os, signal, subprocess, sys, time
if len(sys.argv) > 2 or {deaf}:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
child = os.fork()
if child:
    with open(sys.argv[1] + ".tmp", "w") as note:
        note.write(f"{{os.getpid()}} {{child}}")
    os.rename(sys.argv[1] + ".tmp", sys.argv[1])
time.sleep(300)
"""


def is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:  # it has ended since, or the system has no /proc
        return not Path("/proc/self").exists()
    return state != "Z"


def ends(pid: int, within_s: float = 15.0) -> bool:
    deadline = time.monotonic() + within_s
    while is_running(pid) and time.monotonic() < deadline:
        time.sleep(0.02)
    return not is_running(pid)


def started(tmp_path: Path, deaf: bool) -> tuple[subprocess.Popen[bytes], list[int]]:
    note = tmp_path / "note"
    process = subprocess.Popen(
        [sys.executable, "-c", PARENT, COMMAND.format(deaf=deaf), str(note)],
        env={**os.environ, "PYTHONPATH": str(SOURCE)},
        start_new_session=True,
    )
    deadline = time.monotonic() + 60
    while not note.exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    return process, [int(pid) for pid in note.read_text().split()]


@pytest.mark.parametrize("deaf", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_killed_parent_takes_command_and_children_along(tmp_path: Path, deaf: bool) -> None:
    process, pids = started(tmp_path, deaf)
    assert len(pids) == 2 and all(map(is_running, pids))
    os.killpg(process.pid, signal.SIGKILL)  # the parent and all of its own group
    process.wait()
    assert all(map(ends, pids))


@pytest.mark.slow
def test_a_killed_supervisor_takes_the_command_along(tmp_path: Path) -> None:
    process, pids = started(tmp_path, False)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    if not children.exists():
        process.kill()
        pytest.skip("needs lists of a process's children in /proc: run it on Linux")
    for pid in children.read_text().split():
        os.kill(int(pid), signal.SIGKILL)
    assert process.wait(30) == 1  # an EstimatorFailedError, which nobody handles here
    assert all(map(ends, pids))


@pytest.mark.slow
def test_what_is_ignored_here_is_not_ignored_by_the_command() -> None:
    program = """
import sys
from graspcast.perception.external import run_command
shell = "trap - PIPE; kill -PIPE $$; exit 0"
try:
    run_command(["sh", "-c", shell])
except Exception as error:
    print(error)
"""
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": str(SOURCE)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert f"was killed by signal {int(signal.SIGPIPE)}" in done.stdout


def supervised(*command: str, grace_s: float = 0.2) -> tuple[str, int]:
    """Run the supervisor as a program, and close its pipe once it has said how it went."""
    watched, held = os.pipe()
    report, theirs = os.pipe()
    process = subprocess.Popen(
        [sys.executable, supervisor.__file__, str(watched), str(theirs), str(grace_s), *command],
        pass_fds=(watched, theirs),
        env={**os.environ, "PYTHONPATH": str(SOURCE)},
        stdout=subprocess.DEVNULL,
        start_new_session=True,
    )
    os.close(watched)
    os.close(theirs)
    with os.fdopen(report) as lines:
        said = ""
        for line in lines:
            said += line
            if line.startswith("code "):
                break
        os.close(held)
        return said, process.wait(30)


def test_it_says_how_a_command_ended() -> None:
    said, code = supervised("sh", "-c", "exit 3")
    assert re.fullmatch(r"pid \d+\ncode 3\n", said) and code == 0
    said, _ = supervised("sh", "-c", "kill -9 $$")
    assert re.fullmatch(r"pid \d+\ncode -9\n", said)


def test_it_says_why_a_command_cannot_be_started(tmp_path: Path) -> None:
    said, code = supervised(str(tmp_path / "nothing"))
    assert re.fullmatch(r"(pid \d+\n|error No such file or directory\n){2}code 127\n", said)
    assert code == 0
