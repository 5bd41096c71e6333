"""The extra fetch."""

from __future__ import annotations

import sys

import pytest

from graspcast.errors import ExtraMissingError
from graspcast.fetching.extra import import_httpx


def test_httpx_is_imported() -> None:
    assert import_httpx().__name__ == "httpx"


def test_without_it_the_pip_line_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "httpx", None)
    with pytest.raises(ExtraMissingError, match=r"pip install 'graspcast\[fetch\]'"):
        import_httpx()
