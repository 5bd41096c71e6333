"""The cache of what was fetched: files in place, and receipts by which they are verified."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from graspcast.errors import FormatError
from graspcast.fetching.catalogue import Archive
from graspcast.fetching.disk import writing
from graspcast.fetching.partial_file import digest
from graspcast.io.artefacts import read_artefact, write_artefact
from graspcast.io.cache import cache_directory

__all__ = ["Receipt", "Store"]

_FORMAT = 1
_DOWNLOAD = ("", ".part", ".json")


@dataclass(frozen=True)
class Receipt:
    """What was unpacked of an archive, from where.

    Attributes
    ----------
    url
        Where it came from.
    archive_sha256, stated
        Digest of the archive, and the one that the server stated; empty where it stated none.
    licence
        Name of the licence.
    files
        Size and SHA-256 digest of each file, by its path in the folder.
    """

    url: str
    archive_sha256: str
    stated: str
    licence: str
    files: Mapping[str, tuple[int, str]]


class Store:
    """The cache of what was fetched: ``fetched`` in the cache directory.

    A folder for each dataset and for the release, ``receipts``, ``downloads`` and ``locks``.

    Parameters
    ----------
    root
        Another directory.
    """

    def __init__(self, root: Path | None = None):
        self.root = (root or cache_directory() / "fetched").absolute()

    def folder(self, archive: Archive) -> Path:
        """Return the folder into which an archive is unpacked."""
        return self.root / archive.folder

    def download(self, archive: Archive) -> Path:
        """Return where an archive is downloaded to."""
        return self.root / "downloads" / archive.name

    def lock(self, archive: Archive) -> Path:
        """Return the lock file of an archive's folder."""
        return self.root / "locks" / f"{archive.folder}.lock"

    def _receipt(self, archive: Archive) -> Path:
        return self.root / "receipts" / f"{archive.name}.json"

    def receipt(self, archive: Archive) -> Receipt | None:
        """Return the receipt of an archive; None where there is none that can be relied on."""
        with suppress(FormatError, KeyError, TypeError, ValueError):
            content: dict[str, Any] = read_artefact(self._receipt(archive), "fetch again")
            if content.pop("format") == _FORMAT:
                files = {p: (int(s), str(d)) for p, (s, d) in content.pop("files").items()}
                return Receipt(**content, files=files)
        return None

    def problem(self, archive: Archive, checked: Callable[[float], None]) -> str | None:
        """Return what keeps an archive's files from being used; None if all are as fetched.

        Parameters
        ----------
        archive
            The archive.
        checked
            Called with the share of its files that has been checked.
        """
        receipt = self.receipt(archive)
        if receipt is None:
            there = self._receipt(archive).exists()
            return f"its receipt {self._receipt(archive)} is damaged" if there else "is not cached"
        if not receipt.files:
            return "holds no file"
        for number, (name, (size, sha256)) in enumerate(receipt.files.items(), start=1):
            path = self.folder(archive).joinpath(*name.split("/"))
            try:
                if path.is_symlink() or not path.is_file():
                    return f"{path} is missing"
                if path.stat().st_size != size or digest(path) != sha256:
                    return f"{path} has changed since it was fetched"
            except OSError as error:
                return f"{path} cannot be read ({error.strerror})"
            checked(number / len(receipt.files))
        return None

    def place(self, archive: Archive, unpacked: Path, aside: Path, receipt: Receipt) -> None:
        """Move what was unpacked into place, and write the receipt last.

        Parameters
        ----------
        archive
            The archive.
        unpacked
            Folder with what was unpacked, in the same file system.
        aside
            Empty folder for what is replaced.
        receipt
            The receipt.
        """
        folder = self.folder(archive)
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            for entry in sorted(unpacked.iterdir()):
                target = folder / entry.name
                if target.exists() or target.is_symlink():
                    target.rename(aside / entry.name)
                entry.rename(target)
            write_artefact(self._receipt(archive), {"format": _FORMAT, **asdict(receipt)}, indent=0)

    def has_download(self, archive: Archive) -> bool:
        """Whether something is left of an archive's download."""
        target = self.download(archive)
        return any(target.with_name(target.name + end).exists() for end in _DOWNLOAD)

    def sweep(self, archive: Archive) -> None:
        """Remove what is left of an archive's download."""
        target = self.download(archive)
        for end in _DOWNLOAD:
            with suppress(FileNotFoundError):
                target.with_name(target.name + end).unlink()
