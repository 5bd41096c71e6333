"""Compiled functions, with and without a place for their machine code."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from graspcast.io.compiling import cached_njit

SOURCE = Path(__file__).parents[2] / "src"
PROGRAM = """
from graspcast.io.compiling import cached_njit

@cached_njit()
def double(x):
    return 2 * x

print(double(21))
"""


def run(script: Path, **more: str) -> str:
    done = subprocess.run(
        [sys.executable, str(script)],
        env={"PATH": os.environ["PATH"], "PYTHONPATH": str(SOURCE), **more},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_options_are_passed_on() -> None:
    @cached_njit(fastmath=True)
    def half(x: float) -> float:
        return x / 2

    assert half(3.0) == 1.5
    assert half.targetoptions["fastmath"]


@pytest.mark.slow
def test_machine_code_is_kept(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(PROGRAM)
    assert run(script, NUMBA_CACHE_DIR=str(tmp_path / "cache")) == "42"
    assert list((tmp_path / "cache").rglob("*.nbi"))


@pytest.mark.slow
def test_what_a_killed_process_left_is_removed_with_the_next_write(tmp_path: Path) -> None:
    pytest.importorskip("fcntl", reason="needs locks of POSIX: run it on Linux or macOS")
    script, cache = tmp_path / "script.py", tmp_path / "cache"
    killed = """
import os, signal
real = os.fsync
os.fsync = lambda handle: os.kill(os.getpid(), signal.SIGKILL)
"""
    script.write_text(killed + PROGRAM)
    done = subprocess.run(
        [sys.executable, str(script)],
        env={"PATH": os.environ["PATH"], "PYTHONPATH": str(SOURCE), "NUMBA_CACHE_DIR": str(cache)},
        check=False,
    )
    assert done.returncode == -9
    assert [p for p in cache.rglob("*") if ".tmp" in p.name]
    script.write_text(PROGRAM)
    assert run(script, NUMBA_CACHE_DIR=str(cache)) == "42"
    assert not [p for p in cache.rglob("*") if ".tmp" in p.name]


@pytest.mark.slow
@pytest.mark.skipif(
    not Path("/proc").is_dir(),
    reason="needs a directory that nobody may write, /proc: run it on Linux",
)
def test_where_nothing_can_be_cached_it_is_compiled_all_the_same(tmp_path: Path) -> None:
    # Files of unknown place have no cache directory: what an unwritable installation gives.
    script = tmp_path / "script.py"
    script.write_text(
        "import numba.core.caching as c\nc.CacheImpl._locator_classes = []\nimport sys\n" + PROGRAM
    )
    assert run(script, NUMBA_CACHE_DIR="/proc/none", HOME="/proc/none") == "42"


@pytest.mark.slow
def test_a_full_disk_does_not_matter(tmp_path: Path) -> None:
    resource = pytest.importorskip(
        "resource", reason="limits of processes are POSIX: run it on Linux"
    )
    script = tmp_path / "script.py"
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    script.write_text(
        "import resource, signal\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        f"resource.setrlimit(resource.RLIMIT_FSIZE, (100, {hard}))\n" + PROGRAM
    )
    assert run(script, NUMBA_CACHE_DIR=str(tmp_path / "cache")) == "42"


def test_a_function_without_a_source_file_is_compiled_all_the_same() -> None:
    made: dict[str, Any] = {}
    exec(compile("def double(x):\n    return 2 * x\n", "<typed in>", "exec"), made)
    assert cached_njit()(made["double"])(21) == 42
