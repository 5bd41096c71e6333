"""The cache directory."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from graspcast.io.cache import cache_directory


def test_the_environment_variable_comes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GRASPCAST_CACHE", "/somewhere/else")
    assert cache_directory() == Path("/somewhere/else")


@pytest.mark.skipif(
    sys.platform != "linux", reason="XDG directories are those of Linux: run it there"
)
def test_the_platform_gives_the_default(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("GRASPCAST_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", "/xdg")
    assert cache_directory() == Path("/xdg/graspcast")
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", "/home/someone")
    assert cache_directory() == Path("/home/someone/.cache/graspcast")
