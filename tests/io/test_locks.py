"""Locks between processes."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from graspcast.errors import InputError
from graspcast.io.locks import exclusive_lock

_HOLD = """
import sys, time
from graspcast.io.locks import exclusive_lock
with exclusive_lock(sys.argv[1], "busy"):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_second_process_gets_an_error_at_once_and_a_killed_one_releases(tmp_path: Path) -> None:
    path = tmp_path / "new" / ".lock"
    source = str(Path(__file__).parents[2] / "src")
    other = subprocess.Popen(
        [sys.executable, "-c", _HOLD, str(path)],
        stdout=subprocess.PIPE,
        env={"PYTHONPATH": source},
        text=True,
    )
    try:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        start = time.monotonic()
        with pytest.raises(InputError, match="in use"), exclusive_lock(path, "in use"):
            pytest.fail("two processes hold the lock")
        assert time.monotonic() - start < 1.0
    finally:
        other.send_signal(signal.SIGKILL)
        other.communicate()
    with exclusive_lock(path, "in use"):
        pass


def test_a_second_lock_in_the_same_process_is_refused_too(tmp_path: Path) -> None:
    path = tmp_path / ".lock"
    with (
        exclusive_lock(path, "in use"),
        pytest.raises(InputError, match="in use"),
        exclusive_lock(path, "in use"),
    ):
        pytest.fail("the lock is held twice")
    with exclusive_lock(path, "in use"):
        pass


def test_errors_of_the_block_pass_through_and_release(tmp_path: Path) -> None:
    path = tmp_path / ".lock"
    with pytest.raises(OSError, match="of the block"), exclusive_lock(path, "in use"):
        raise OSError("of the block")
    with exclusive_lock(path, "in use"):
        pass


def test_a_directory_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(InputError, match="cannot be written"),
        exclusive_lock(tmp_path / "file" / ".lock", "in use"),
    ):
        pytest.fail("there is no such directory")
