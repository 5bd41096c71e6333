"""A server for each test, and limits that do not let it wait."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from download_server import Server, serving
from graspcast.fetching.limits import Limits

QUICK = Limits(
    connect_s=5.0,
    stall_s=0.3,
    stall_bytes=200,
    attempts=3,
    unreachable_attempts=2,
    progress_bytes=1000,
    backoff_s=0.01,
    longest_wait_s=0.2,
    lock_s=30.0,
)
"""Limits that do not let a test wait."""


@pytest.fixture
def limits() -> Limits:
    return QUICK


@pytest.fixture
def server() -> Iterator[Server]:
    with serving() as server:
        yield server


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GRASPCAST_CACHE", str(tmp_path / "cache"))
    for name in ("HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY", "NO_PROXY", "GRASPCAST_OFFLINE"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.lower(), raising=False)
