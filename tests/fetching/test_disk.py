"""Disk space and sizes in words."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from graspcast.errors import DownloadError, InputError
from graspcast.fetching.disk import check_space, in_words, writing


def test_words() -> None:
    assert [in_words(n) for n in (0, 999, 5_684, 117_550_985, 1_184_000_000)] == [
        "0 bytes", "999 bytes", "5.68 kB", "118 MB", "1.18 GB",
    ]  # fmt: skip


def test_space(tmp_path: Path) -> None:
    check_space(tmp_path / "no" / "folder" / "a.zip", 10, 0)
    with pytest.raises(InputError, match="GRASPCAST_CACHE"):
        check_space(tmp_path / "no" / "folder" / "a.zip", 10, 10**18)
    with pytest.raises(DownloadError, match="its limit of 5 bytes"):
        check_space(tmp_path / "a.zip", 10, 0, most=5)


def test_a_full_disk_is_an_input_error(tmp_path: Path) -> None:
    with (
        pytest.raises(InputError, match=r"a.zip: cannot be written .No space left"),
        writing(tmp_path / "a.zip"),
    ):
        raise OSError(errno.ENOSPC, "No space left on device")
