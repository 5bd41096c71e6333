"""Fetching of an item: verified where it is there, else downloaded, checked and put in place."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from graspcast.errors import DownloadError, FormatError, InputError
from graspcast.fetching.addresses import below, shown
from graspcast.fetching.archives import Unpacked, unpack
from graspcast.fetching.catalogue import Archive, Item, item_named
from graspcast.fetching.disk import in_words, writing
from graspcast.fetching.download import Downloaded, download
from graspcast.fetching.git_tree import git_tree
from graspcast.fetching.limits import Limits
from graspcast.fetching.store import Receipt, Store
from graspcast.io.files import temporary_directory
from graspcast.io.locks import exclusive_lock
from graspcast.io.progress import Progress

__all__ = ["OFFLINE", "Fetched", "FetchedArchive", "fetch", "is_offline"]

OFFLINE = "GRASPCAST_OFFLINE"
"""The environment variable that forbids downloads, where it is 1."""

_DOWNLOADED = 0.7


@dataclass(frozen=True)
class FetchedArchive:
    """An archive of an item, as it is in the cache.

    Attributes
    ----------
    name, url
        Its name, and where it came from.
    sha256
        Digest of the archive.
    files, size
        Number of files, and their bytes.
    new
        Whether it was downloaded now.
    remarks
        What was odd, and by what it was checked.
    """

    name: str
    url: str
    sha256: str
    files: int
    size: int
    new: bool
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class Fetched:
    """An item in the cache.

    Attributes
    ----------
    item
        The item.
    path
        Its folder: of a BOP dataset, or of the release.
    archives
        Its archives.
    """

    item: Item
    path: Path
    archives: tuple[FetchedArchive, ...]


def is_offline() -> bool:
    """Whether the environment variable ``GRASPCAST_OFFLINE`` forbids downloads."""
    return os.environ.get(OFFLINE, "").strip().lower() not in ("", "0", "false", "no", "off")


def fetch(
    name: str,
    *,
    mirror: str | None = None,
    offline: bool | None = None,
    again: bool = False,
    store: Store | None = None,
    limits: Limits | None = None,
    progress: Progress | None = None,
) -> Fetched:
    """Fetch an item of the catalogue into the cache, or verify what is there.

    What is there is compared with the digests of its first download. What is missing or has changed
    is downloaded; an interrupted download goes on where it ended. Several processes may fetch at
    once: one does, and the others wait.

    Parameters
    ----------
    name
        Name in :data:`graspcast.fetching.catalogue.ITEMS`.
    mirror
        An address or directory that holds the archives by their names, in place of their sources.
    offline
        Whether nothing is downloaded; by default as ``GRASPCAST_OFFLINE`` says.
    again
        Whether to download anew, and accept what differs from the first download.
    store
        The cache.
    limits
        Times and sizes.
    progress
        Called with the share done and what is done.

    Raises
    ------
    UnknownNameError
        If there is no such item.
    DownloadError
        If it cannot be downloaded, or is not what it was or should be.
    FormatError
        If an archive is damaged or not safe to unpack.
    InputError
        If the cache cannot be written, or nothing may be downloaded.
    """
    item, store, limits = item_named(name), store or Store(), limits or Limits()
    offline = is_offline() if offline is None else offline
    done, found = 0.0, []
    for archive in item.archives:
        weight = archive.about_bytes / item.about_bytes

        def report(share: float, message: str, start: float = done, weight: float = weight) -> None:
            if progress is not None:
                progress(min(1.0, start + share * weight), message)

        url = archive.url if mirror is None else below(mirror, archive.name)
        job = _Job(archive, url, store, limits, report)
        found.append(job.run(offline=offline, again=again))
        done += weight
    return Fetched(item, store.folder(item.archives[0]), tuple(found))


@dataclass
class _Job:
    """The fetching of one archive."""

    archive: Archive
    url: str
    store: Store
    limits: Limits
    report: Callable[[float, str], None]

    def run(self, *, offline: bool, again: bool) -> FetchedArchive:
        archive, store = self.archive, self.store
        problem = "is to be fetched again" if again else self._problem()
        if problem is None and not store.has_download(archive):
            return self._outcome(new=False, remarks=())  # needs no lock, nor that it can be written
        if problem is not None and offline:
            raise InputError(
                f"{archive.name}: {problem} (cache: {store.root}), and nothing is downloaded "
                f"offline or where {OFFLINE} is set; fetch it once with a network, or copy this "
                "directory from where it was fetched",
                parameters=("offline",),
            )
        lock = store.lock(archive)
        with writing(lock):
            lock.parent.mkdir(parents=True, exist_ok=True)
        with exclusive_lock(
            lock,
            f"{store.folder(archive)}: another process has been fetching it for "
            f"{self.limits.lock_s:.0f} s; end it, or wait for it",
            wait_s=self.limits.lock_s,
        ):
            problem = problem if again else self._problem()
            if problem is None:
                store.sweep(archive)
                return self._outcome(new=False, remarks=())
            earlier = store.receipt(archive)
            remarks = [] if again or earlier is None else [f"{problem}: it was fetched again"]
            remarks += self._fetch(earlier, again)
            return self._outcome(new=True, remarks=tuple(remarks))

    def _problem(self) -> str | None:
        text = f"{self.archive.name}: verifying"
        return self.store.problem(self.archive, lambda share: self.report(share, text))

    def _outcome(self, *, new: bool, remarks: tuple[str, ...]) -> FetchedArchive:
        receipt = self.store.receipt(self.archive)
        if receipt is None:
            raise DownloadError(f"{self.archive.name}: its receipt was removed meanwhile")
        size = sum(size for size, _ in receipt.files.values())
        self.report(1.0, f"{self.archive.name}: there")
        return FetchedArchive(
            self.archive.name,
            receipt.url,
            receipt.archive_sha256,
            len(receipt.files),
            size,
            new,
            remarks,
        )

    def _fetch(self, earlier: Receipt | None, again: bool) -> list[str]:
        """Download, unpack, check and place the archive; return what is to be told."""
        archive, store, limits = self.archive, self.store, self.limits
        if again and store.download(archive).exists():
            store.sweep(archive)
        most = max(limits.smallest_limit, limits.size_factor * archive.about_bytes)
        with writing(store.root):
            store.download(archive).parent.mkdir(parents=True, exist_ok=True)
        got = download(
            self.url,
            store.download(archive),
            most_bytes=most,
            limits=limits,
            arrived=self._arrived,
        )
        try:
            with temporary_directory(store.root) as work:
                for name in ("new", "old"):
                    (work / name).mkdir()
                unpacked = self._unpack(got.path, work / "new")
                remarks = self._checked(unpacked, work / "new", got, earlier, again)
                receipt = Receipt(
                    shown(self.url), got.sha256, got.stated, archive.licence.name, unpacked.files
                )
                store.place(archive, work / "new", work / "old", receipt)
        except (DownloadError, FormatError):
            store.sweep(archive)  # what is wrong is not kept to be found wrong again
            raise
        store.sweep(archive)
        return remarks

    def _arrived(self, size: int, length: int | None, remark: str) -> None:
        whole = length or max(size, self.archive.about_bytes)
        done = f"{in_words(size)} of {in_words(length)}" if length else in_words(size)
        text = f"{self.archive.name}: {done}" + (f"; {remark}" if remark else "")
        self.report(_DOWNLOADED * min(1.0, size / whole), text)

    def _unpack(self, path: Path, into: Path) -> Unpacked:
        def unpacked(size: int) -> None:
            share = min(1.0, size / (3 * self.archive.about_bytes))
            self.report(
                _DOWNLOADED + (1 - _DOWNLOADED) * share,
                f"{self.archive.name}: unpacking, {in_words(size)}",
            )

        return unpack(
            path,
            into,
            root=self.archive.root,
            takes=self.archive.takes,
            limits=self.limits,
            unpacked=unpacked,
        )

    def _checked(
        self,
        unpacked: Unpacked,
        folder: Path,
        got: Downloaded,
        earlier: Receipt | None,
        again: bool,
    ) -> list[str]:
        """Raise if it is not what was expected; return what is to be told."""
        archive, remarks = self.archive, []
        if not (folder / archive.needs).exists():
            tops = sorted({name.split("/")[0] for name in unpacked.files} | set(unpacked.left_out))
            raise FormatError(
                archive.name,
                f"lacks {archive.needs}; it holds {', '.join(tops[:10]) or 'nothing'}: it is "
                "another archive, and is not used",
                parameters=("mirror",),
            )
        if archive.git_tree is not None and git_tree(folder, unpacked.files) != archive.git_tree:
            raise DownloadError(
                f"{shown(self.url)}: holds other files than the commit that it is to be (its git "
                f"tree is not {archive.git_tree}); it is not used",
                parameters=("mirror",),
            )
        if archive.git_tree is not None:
            remarks.append(f"its files are those of the git tree {archive.git_tree}")
        elif got.stated:
            remarks.append("its SHA-256 is the one that the server states")
        elif earlier is None:
            remarks.append(
                "its source states no checksum: that of this download is recorded, and compared "
                "from now on"
            )
        if earlier is not None and dict(earlier.files) != unpacked.files:
            if not again:
                raise DownloadError(
                    f"{shown(self.url)}: its files differ from those fetched first, from "
                    f"{earlier.url}; fetch again if that is as it should be",
                    parameters=("again",),
                )
            remarks.append(f"its files differ from those fetched before, from {earlier.url}")
        if unpacked.left_out:
            remarks.append(f"not unpacked: {', '.join(unpacked.left_out[:10])}")
        return remarks
