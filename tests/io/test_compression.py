"""Compressed files given where plain ones are read."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from graspcast.bop.results import read_results
from graspcast.errors import FormatError
from graspcast.io.json import read_json


def test_a_compressed_file_is_named_as_such(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(gzip.compress(b"[]"))
    with pytest.raises(FormatError, match=r"is a gzip file \(unpack it first\)"):
        read_json(path, list)
    with pytest.raises(FormatError, match=r"is a gzip file \(unpack it first\)"):
        read_results(path)


def test_another_encoding(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes("é".encode("latin-1"))
    with pytest.raises(FormatError, match="is not UTF-8 text"):
        read_json(path, list)
    with pytest.raises(FormatError, match="is not UTF-8 text"):
        read_results(path)
