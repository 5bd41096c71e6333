from __future__ import annotations

import importlib.util

import pytest

from graspcast.errors import ExtraMissingError
from graspcast.service import extra


def test_what_is_missing_is_named_with_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    extra.check_installed()
    find = importlib.util.find_spec
    monkeypatch.setattr(extra, "find_spec", lambda m: None if m == "uvicorn" else find(m))
    with pytest.raises(ExtraMissingError, match=r"uvicorn.*pip install 'graspcast\[serve\]'"):
        extra.check_installed()
