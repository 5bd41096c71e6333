"""Partial files: what has arrived of a download, and by what its rest can be asked for."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from graspcast.errors import FormatError
from graspcast.io.artefacts import read_artefact, write_artefact

__all__ = ["PartialFile", "Version", "digest"]


@dataclass(frozen=True)
class Version:
    """A version of a file, as a server states it.

    Attributes
    ----------
    etag, modified
        The headers ``ETag`` and ``Last-Modified``; empty where there is none.
    length
        Bytes in all; None where the server does not say.
    """

    etag: str = ""
    modified: str = ""
    length: int | None = None

    @property
    def validator(self) -> str:
        """What ``If-Range`` may hold: a strong ETag, else a date; empty where there is neither."""
        if self.etag:
            return "" if self.etag.startswith("W/") else self.etag
        return self.modified

    def contradicts(self, other: Version) -> bool:
        """Whether this and another statement cannot be about the same version."""
        pairs = (
            (self.etag, other.etag),
            (self.modified, other.modified),
            (self.length, other.length),
        )
        return any(a != b for a, b in pairs if a not in ("", None) and b not in ("", None))


class PartialFile:
    """What has arrived of a download, beside its target, with a record of its version.

    The record is written before the bytes, so that a killed process leaves the beginning of a known
    version.

    Parameters
    ----------
    target
        Where the whole file is to be.
    url
        The address asked for.
    """

    def __init__(self, target: Path, url: str):
        self.target, self.url = target, url
        self.path = target.with_name(target.name + ".part")
        self._record = target.with_name(target.name + ".json")
        self.version = Version()
        content = self._read()
        if content.get("url") == url and "sha256_of_file" not in content:
            self.version = Version(
                content.get("etag", ""), content.get("modified", ""), content.get("length")
            )

    def _read(self) -> dict[str, Any]:
        try:
            return read_artefact(self._record, "download again")
        except FormatError:
            return {}

    @property
    def size(self) -> int:
        """Bytes that have arrived."""
        try:
            return self.path.stat().st_size
        except FileNotFoundError:
            return 0

    def resumable(self) -> int:
        """Return from which byte the download can go on; 0 where it must begin anew."""
        size, length = self.size, self.version.length
        beyond = length is not None and size > length
        return size if self.version.validator and not beyond else 0

    def begin(self, version: Version) -> None:
        """Begin anew with a version."""
        self.discard()
        self.version = version
        self.target.parent.mkdir(parents=True, exist_ok=True)
        self._write({"etag": version.etag, "modified": version.modified, "length": version.length})

    def _write(self, content: dict[str, Any]) -> None:
        write_artefact(self._record, {"url": self.url, **content})

    def discard(self) -> None:
        """Remove what there is, the whole file too."""
        self.version = Version()
        for path in (self._record, self.path, self.target):
            with suppress(FileNotFoundError):
                path.unlink()

    def finish(self, stated: str) -> str:
        """Make it the target; return its digest, recorded with the one that the server stated."""
        found = digest(self.path)
        self._write({"sha256_of_file": found, "stated": stated})
        self.path.replace(self.target)
        return found

    def finished(self) -> tuple[str, str] | None:
        """Return the digest of a target that is whole, and the stated one; None if it is not."""
        content = self._read()
        if content.get("url") != self.url or "sha256_of_file" not in content:
            return None
        with suppress(OSError):
            if digest(self.target) == content["sha256_of_file"]:
                return content["sha256_of_file"], content["stated"]
        return None


def digest(path: Path) -> str:
    """Compute the SHA-256 digest of a file of any size, as hexadecimal digits."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
