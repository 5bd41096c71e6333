"""Directories of zip files, checked before they are read."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import pytest

from bop_archives import zipped
from graspcast.fetching.zip_directory import check_directory


def written(tmp_path: Path, content: bytes) -> Path:
    (tmp_path / "a.zip").write_bytes(content)
    return tmp_path / "a.zip"


@pytest.mark.parametrize("before", [b"", b"x" * 100])
def test_a_small_directory(tmp_path: Path, before: bytes) -> None:
    check_directory(written(tmp_path, before + zipped({"a": b"1"})), 10)


def test_a_comment_does_not_hide_it(tmp_path: Path) -> None:
    archive = written(tmp_path, zipped({"a": b"1"}))
    with zipfile.ZipFile(archive, "a") as opened:
        opened.comment = b"x" * 60_000
    check_directory(archive, 10)


def test_many_members(tmp_path: Path) -> None:
    archive = written(tmp_path, zipped({f"{i:0100}": b"" for i in range(100)}))
    check_directory(archive, 100)
    with pytest.raises(zipfile.BadZipFile, match="its directory has"):
        check_directory(archive, 10)


@pytest.mark.parametrize("place", [0, 2**63])
def test_a_large_directory_of_zip64(tmp_path: Path, place: int) -> None:
    record = b"PK\x06\x06" + bytes(36) + struct.pack("<QQ", 2**31, 0)
    locator = b"PK\x06\x07" + struct.pack("<IQI", 0, place, 1)
    end = b"PK\x05\x06" + bytes(8) + struct.pack("<II", 2**32 - 1, 0) + bytes(2)
    with pytest.raises(zipfile.BadZipFile, match="its directory has 2,147,483,648"):
        check_directory(written(tmp_path, record + locator + end), 10)


@pytest.mark.parametrize("content", [b"", b"PK", b"x" * 100])
def test_no_directory(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(zipfile.BadZipFile, match="no directory"):
        check_directory(written(tmp_path, content), 10)
