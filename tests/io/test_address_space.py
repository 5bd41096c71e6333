"""Limits on the address space."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from graspcast.errors import InputError
from graspcast.io.address_space import check_address_space

SOURCE = Path(__file__).parents[2] / "src"
resource = pytest.importorskip("resource", reason="limits of processes are POSIX: run it on Linux")


def limited(limit: int, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [
            sys.executable,
            "-c",
            f"import resource; resource.setrlimit(resource.RLIMIT_AS, ({limit}, -1))\n"
            f"import sys; from graspcast.cli import main; sys.exit(main({list(arguments)!r}))",
        ],
        env={**os.environ, "PYTHONPATH": str(SOURCE)},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="elsewhere it is not enforced: run it on Linux"
)
@pytest.mark.parametrize("limit", [300_000_000, 1_000_000_000])
def test_too_little_is_said_before_anything_is_loaded(limit: int, tmp_path: Path) -> None:
    done = limited(limit, "grasps", "--out", str(tmp_path / "sheet.png"))
    assert done.returncode == 2
    assert f"limited to {limit / 1e9:.2f} GB; at least" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_the_least_that_is_named_is_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (10**9, 10**9))
    with pytest.raises(InputError) as refused:
        check_address_space()
    least = re.search(r"ulimit -v (\d+)", str(refused.value))
    assert least is not None
    monkeypatch.setattr(resource, "getrlimit", lambda _: (int(least[1]) * 1024, -1))
    check_address_space()


def test_no_limit_is_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    unlimited = resource.RLIM_INFINITY
    monkeypatch.setattr(resource, "getrlimit", lambda _: (unlimited, unlimited))
    check_address_space()
