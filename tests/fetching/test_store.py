"""The cache: what is there, what has changed, and what is replaced."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from graspcast.fetching.catalogue import ITEMS
from graspcast.fetching.store import Receipt, Store

ARCHIVE = ITEMS["lmo"].archives[1]


def place(store: Store, work: Path, content: bytes) -> Receipt:
    new, old = work / "new", work / "old"
    (new / "models").mkdir(parents=True)
    old.mkdir()
    (new / "models" / "a").write_bytes(content)
    files = {"models/a": (len(content), hashlib.sha256(content).hexdigest())}
    receipt = Receipt("https://host/a", "0" * 64, "", "MIT", files)
    store.place(ARCHIVE, new, old, receipt)
    return receipt


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "root")


def test_receipts_are_read_back(store: Store, tmp_path: Path) -> None:
    assert store.receipt(ARCHIVE) is None
    assert store.problem(ARCHIVE, lambda _: None) == "is not cached"
    receipt = place(store, tmp_path, b"1")
    assert store.receipt(ARCHIVE) == receipt
    assert store.problem(ARCHIVE, lambda _: None) is None


def test_a_folder_is_replaced_as_a_whole(store: Store, tmp_path: Path) -> None:
    place(store, tmp_path / "1", b"1")
    (store.folder(ARCHIVE) / "models" / "other").write_bytes(b"")
    place(store, tmp_path / "2", b"2")
    assert [p.name for p in (store.folder(ARCHIVE) / "models").iterdir()] == ["a"]
    assert (tmp_path / "2" / "old" / "models" / "other").exists()


@pytest.mark.parametrize("content", ["", "{}", '{"format": 2}', "[]", "\0"])
def test_a_damaged_receipt_is_none(store: Store, tmp_path: Path, content: str) -> None:
    place(store, tmp_path, b"1")
    (path,) = (store.root / "receipts").iterdir()
    path.write_text(content)
    assert store.receipt(ARCHIVE) is None
    assert "is damaged" in str(store.problem(ARCHIVE, lambda _: None))


def test_downloads_are_swept(store: Store) -> None:
    target = store.download(ARCHIVE)
    target.parent.mkdir(parents=True)
    target.with_name(target.name + ".part").write_bytes(b"1")
    assert store.has_download(ARCHIVE)
    store.sweep(ARCHIVE)
    assert not store.has_download(ARCHIVE)


def test_the_cache_directory_is_that_of_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GRASPCAST_CACHE", str(tmp_path / "here"))
    assert Store().root == tmp_path / "here" / "fetched"


def test_a_receipt_of_no_file_and_files_that_cannot_be_read(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place(store, tmp_path, b"1")

    def refuse(path: Path) -> str:  # as for others than root
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("graspcast.fetching.store.digest", refuse)
    said = store.problem(ARCHIVE, lambda _: None)
    assert said is not None and said.endswith("a cannot be read (Permission denied)")
    (tmp_path / "none" / "new").mkdir(parents=True)
    (tmp_path / "none" / "old").mkdir()
    empty = Receipt("https://host/a", "0" * 64, "", "MIT", {})
    store.place(ARCHIVE, tmp_path / "none" / "new", tmp_path / "none" / "old", empty)
    assert store.problem(ARCHIVE, lambda _: None) == "holds no file"
