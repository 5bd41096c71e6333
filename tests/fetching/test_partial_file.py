"""Partial files and the versions that servers state."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from graspcast.fetching.partial_file import PartialFile, Version, digest

URL = "https://host/a.zip"
VERSION = Version('"v1"', "", 100)


def begun(folder: Path, version: Version = VERSION, size: int = 40) -> Path:
    part = PartialFile(folder / "a.zip", URL)
    part.begin(version)
    part.path.write_bytes(bytes(size))
    return folder / "a.zip"


def test_another_process_finds_what_has_arrived(tmp_path: Path) -> None:
    part = PartialFile(begun(tmp_path), URL)
    assert (part.size, part.resumable(), part.version) == (40, 40, VERSION)


@pytest.mark.parametrize(
    "version", [Version(), Version('W/"weak"', "", 100), Version('"v1"', "", 30)]
)
def test_what_is_not_resumed(tmp_path: Path, version: Version) -> None:
    assert PartialFile(begun(tmp_path, version), URL).resumable() == 0


def test_a_date_serves_as_a_validator() -> None:
    assert Version("", "Tue, 01 Oct 2024 00:00:00 GMT").validator.startswith("Tue")


def test_another_address_or_a_damaged_record_is_not_resumed(tmp_path: Path) -> None:
    target = begun(tmp_path)
    assert PartialFile(target, "https://other/a.zip").resumable() == 0
    (tmp_path / "a.zip.json").write_text("{")
    assert PartialFile(target, URL).resumable() == 0


def test_contradictions() -> None:
    assert VERSION.contradicts(Version('"v2"'))
    assert VERSION.contradicts(Version("", "", 99))
    assert not VERSION.contradicts(Version("", "x", None))


def test_a_whole_file_is_known_by_its_digest(tmp_path: Path) -> None:
    part = PartialFile(begun(tmp_path), URL)
    assert part.finished() is None
    sha256 = part.finish("stated")
    assert sha256 == hashlib.sha256(bytes(40)).hexdigest() == digest(tmp_path / "a.zip")
    assert PartialFile(tmp_path / "a.zip", URL).finished() == (sha256, "stated")
    assert PartialFile(tmp_path / "a.zip", "https://other/a.zip").finished() is None
    (tmp_path / "a.zip").write_bytes(b"changed")
    assert PartialFile(tmp_path / "a.zip", URL).finished() is None


def test_discarding_removes_all(tmp_path: Path) -> None:
    PartialFile(begun(tmp_path), URL).discard()
    assert not list(tmp_path.iterdir())
