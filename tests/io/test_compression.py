"""Compressed files: gzip is unpacked, others are named."""

from __future__ import annotations

import bz2
import gzip
from pathlib import Path

import pytest

from graspcast.bop.results import read_results
from graspcast.errors import FormatError
from graspcast.io.compression import gunzipped
from graspcast.io.json import read_json
from graspcast.io.reading import read_text


def test_gzip_is_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "file.json.gz"
    path.write_bytes(gzip.compress(b"[1, ") + gzip.compress(b"2]"))
    assert read_json(path, list) == [1, 2]


def test_a_damaged_or_huge_gzip_file_is_refused(tmp_path: Path) -> None:
    path, packed = tmp_path / "file.json.gz", gzip.compress(b"[]" * 1000)
    for content, says in (
        (packed[:-9], "ends too early"),
        (packed[:12] + b"\xff" * 9 + packed[21:], "is a damaged gzip file"),
        (gzip.compress(b" " * 5000), "more than 4,000 bytes when it is unpacked"),
    ):
        path.write_bytes(content)
        with pytest.raises(FormatError, match=says):
            read_text(path, 4000)
    assert gunzipped(b"plain", 1) == b"plain"


def test_another_compressed_file_is_named_as_such(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(bz2.compress(b"[]"))
    with pytest.raises(FormatError, match=r"is a bzip2 file \(unpack it first\)"):
        read_json(path, list)
    with pytest.raises(FormatError, match=r"is a bzip2 file \(unpack it first\)"):
        read_results(path)


def test_another_encoding(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes("é".encode("latin-1"))
    with pytest.raises(FormatError, match="is not UTF-8 text"):
        read_json(path, list)
    with pytest.raises(FormatError, match="is not UTF-8 text"):
        read_results(path)


def test_what_to_do_about_another_encoding(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes("[1]\n".encode("utf-16"))
    with pytest.raises(FormatError, match="not UTF-8 text but UTF-16; save it as UTF-8"):
        read_json(path, list)
    path.write_bytes('[\n"é"]'.encode("latin-1"))
    with pytest.raises(FormatError, match=r"\(byte 0xe9 in line 2\); save it as UTF-8"):
        read_json(path, list)
