"""The command line where something that is usually there is not."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(
    os.name != "posix", reason="needs a POSIX shell: run it on Linux or macOS"
)

ROOT = Path(__file__).parents[2]
VERB = "-m graspcast check-gripper parallel"
CAMPAIGN = f"{ROOT / 'tests' / 'campaign_script.py'}"
NO_SEMAPHORES = """
import _multiprocessing

class SemLock:
    SEM_VALUE_MAX = 2147483647

    def __init__(self, *arguments, **more):
        raise OSError(38, "Function not implemented")

_multiprocessing.SemLock = SemLock
"""


def shell(line: str, tmp_path: Path, **more: str) -> subprocess.CompletedProcess[str]:
    """Run a line of a shell in which $PYTHON is this Python, and HOME does not exist."""
    return subprocess.run(
        ["bash", "-o", "pipefail", "-c", line.replace("$PYTHON", sys.executable)],
        env={
            "PATH": os.environ["PATH"],
            "PYTHONPATH": str(ROOT / "src"),
            "HOME": "/proc/none",
            **more,
        },
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.mark.slow
def test_output_that_nobody_reads(tmp_path: Path) -> None:
    done = shell(f"$PYTHON {VERB} | true", tmp_path)
    assert done.returncode == 141, done.stderr
    assert done.stderr == ""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full: run it on Linux")
def test_output_onto_a_full_disk(tmp_path: Path) -> None:
    done = shell(f"$PYTHON {VERB} > /dev/full", tmp_path)
    assert done.returncode == 2
    assert "graspcast check-gripper: standard output or error cannot be written" in done.stderr
    assert "No space left" in done.stderr
    assert "Traceback" not in done.stderr and "Exception" not in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("closed", ["<&- >&- 2>&-", "<&-", ">&-", "2>&-"])
def test_closed_streams(tmp_path: Path, closed: str) -> None:
    done = shell(f"$PYTHON {VERB} {closed}", tmp_path)
    assert done.returncode == 0
    assert done.stderr == ""


@pytest.mark.slow
def test_a_terminal_of_another_encoding(tmp_path: Path) -> None:
    program = "import sys; from graspcast.cli import main; sys.exit(main())"
    settings = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii", "TERM": "dumb"}
    done = shell(
        f"$PYTHON -c '{program}' watch --object ä --gripper … --out x.png", tmp_path, **settings
    )
    assert done.returncode == 2
    assert "graspcast watch: " in done.stderr and "Traceback" not in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("limit", ["4000000", "2500000"])
def test_little_address_space(tmp_path: Path, limit: str) -> None:
    done = shell(f"ulimit -v {limit}; $PYTHON {CAMPAIGN} out 20 2", tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "outcomes.parquet").exists()


@pytest.mark.slow
def test_a_campaign_needs_no_semaphores(tmp_path: Path) -> None:
    """Which need /dev/shm."""
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "sitecustomize.py").write_text(NO_SEMAPHORES)
    path = f"{tmp_path / 'site'}:{ROOT / 'src'}"
    proof = "from multiprocessing import get_context; get_context().Lock()"
    assert (
        "Function not implemented"
        in shell(f"$PYTHON -c '{proof}'", tmp_path, PYTHONPATH=path).stderr
    )
    done = shell(f"$PYTHON {CAMPAIGN} out 20 2", tmp_path, PYTHONPATH=path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "outcomes.parquet").exists()
