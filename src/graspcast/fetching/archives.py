"""Archives: zip and tar.gz files read member by member, and unpacked where nothing is unsafe."""

from __future__ import annotations

import fnmatch
import gzip
import hashlib
import lzma
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import BufferedIOBase
from pathlib import Path
from typing import Any, cast

from graspcast.errors import FormatError
from graspcast.fetching.disk import check_space, in_words, writing
from graspcast.fetching.limits import Limits
from graspcast.fetching.member_names import Names, UnsafeNameError, parts_of
from graspcast.fetching.tar_stream import BoundedStream, OversizeError
from graspcast.fetching.zip_directory import check_directory

__all__ = ["Unpacked", "unpack"]

_CHUNK = 1 << 18
_BROKEN = (
    EOFError, NotImplementedError, OSError, OverflowError, RuntimeError, UnicodeError, ValueError,
    lzma.LZMAError, struct.error, tarfile.TarError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip


@dataclass
class Unpacked:
    """What was unpacked.

    Attributes
    ----------
    files
        Size and SHA-256 digest of each file, by its path with slashes.
    left_out
        Names at the top that were not asked for.
    """

    files: dict[str, tuple[int, str]] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Member:
    name: str
    folder: bool
    size: int
    open: Callable[[], BufferedIOBase]


def unpack(
    archive: Path,
    into: Path,
    *,
    root: str,
    takes: Sequence[str],
    limits: Limits,
    unpacked: Callable[[int], None],
) -> Unpacked:
    """Unpack an archive into an empty folder.

    Every member is checked before it is written: its name, that it is a file or a folder, and the
    sizes so far. Permissions and times are not taken over.

    Parameters
    ----------
    archive
        A ``.zip`` or ``.tar.gz`` file.
    into
        The folder. Where this raises, it may hold a part.
    root
        A first folder that is left out where a member has it; ``"*"`` for any that all share.
    takes
        Patterns of the names at the top that are unpacked.
    limits
        Sizes and numbers.
    unpacked
        Called with the bytes unpacked so far.

    Raises
    ------
    FormatError
        If it is damaged, is no archive, or is not safe.
    InputError
        If the disk has no space for it.
    """
    found, names, total = Unpacked(), Names(), 0
    roots: set[str] = set()
    with _broken(archive), _members(archive, into, limits) as members:
        for number, member in enumerate(members, start=1):
            total += member.size
            _check_amounts(archive, number, total, limits)
            try:
                parts = parts_of(member.name)
                inner = parts[1:] if root in ("*", parts[0]) else parts
                names.add(inner, folder=member.folder)
                if root == "*":
                    roots.add(parts[0])
                    if len(roots) > 1 or (len(parts) == 1 and not member.folder):
                        raise UnsafeNameError("lies outside the folder that holds all others")
            except UnsafeNameError as error:
                raise _unsafe(archive, member.name, str(error)) from None
            if not inner:
                continue
            if not any(fnmatch.fnmatchcase(inner[0], pattern) for pattern in takes):
                found.left_out.append(inner[0])
                continue
            if member.folder:
                into.joinpath(*inner).mkdir(parents=True, exist_ok=True)
                continue
            found.files["/".join(inner)] = _write(member, into.joinpath(*inner), archive)
            unpacked(total)
    found.left_out = sorted(set(found.left_out))
    return found


def _check_amounts(archive: Path, number: int, total: int, limits: Limits) -> None:
    if number > limits.members:
        raise _unsafe(archive, "", f"it has more than {limits.members:,} members")
    if total > limits.unpacked_bytes:
        raise _unsafe(archive, "", f"it unpacks to more than {in_words(limits.unpacked_bytes)}")
    packed = archive.stat().st_size
    if total > limits.ratio_from and total > limits.ratio * packed:
        raise _unsafe(
            archive, "", f"{in_words(packed)} unpack to {in_words(total)} or more, as in a bomb"
        )


def _unsafe(archive: Path, member: str, problem: str) -> FormatError:
    return FormatError(
        archive.name,
        f"{problem}; the archive is not safe to unpack, and nothing of it was",
        where=f"the member {member!r}" if member else None,
    )


def _write(member: _Member, path: Path, archive: Path) -> tuple[int, str]:
    """Write a member to a new file; return its size and digest."""
    sha256, size = hashlib.sha256(), 0
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        out = path.open("xb")
    with out, member.open() as stream:
        while chunk := stream.read(_CHUNK):
            size += len(chunk)
            if size > member.size:
                raise _unsafe(archive, member.name, "is larger than the archive says")
            sha256.update(chunk)
            with writing(path):
                out.write(chunk)
                out.flush()
    if size != member.size:
        raise EOFError(f"{member.name!r} is shorter than the archive says")
    return size, sha256.hexdigest()


@contextmanager
def _broken(archive: Path) -> Iterator[None]:
    """Turn what the libraries raise on a damaged archive into an error that names it."""
    try:
        yield
    except OversizeError as error:
        raise _unsafe(archive, "", str(error)) from None
    except _BROKEN as error:
        with archive.open("rb") as stream:
            start = stream.read(200).lstrip().lower()
        page = start.startswith((b"<!doctype", b"<html"))
        what = "a web page, and no archive" if page else f"damaged or no archive ({error})"
        raise FormatError(archive.name, f"is {what}; download it again") from error


@contextmanager
def _members(archive: Path, into: Path, limits: Limits) -> Iterator[Iterator[_Member]]:
    if archive.name.endswith(".zip"):
        check_directory(archive, limits.members)
        with zipfile.ZipFile(archive) as opened:
            infos = opened.infolist()
            _check_amounts(archive, len(infos), sum(i.file_size for i in infos), limits)
            check_space(into, sum(i.file_size for i in infos), limits.spare_bytes)
            yield (_zip_member(archive, opened, info) for info in infos)
    else:
        with gzip.open(archive) as unpacked:
            stream = BoundedStream(unpacked, limits.unpacked_bytes)
            with tarfile.open(fileobj=cast(Any, stream), mode="r:", errorlevel=2) as tar:
                yield (_tar_member(archive, tar, info) for info in tar)
            while stream.read(_CHUNK):
                pass  # the checksum is at the end


def _zip_member(archive: Path, opened: zipfile.ZipFile, info: zipfile.ZipInfo) -> _Member:
    mode = (info.external_attr >> 16) & 0o170000
    # Systems without such modes write 0.
    if info.create_system == 3 and mode not in (0, 0o100000, 0o040000):
        raise _unsafe(archive, info.filename, "is a link or a device")
    if info.flag_bits & 0x1:
        raise _unsafe(archive, info.filename, "is encrypted")
    name = info.orig_filename
    return _Member(
        name, info.is_dir(), info.file_size, lambda: cast(BufferedIOBase, opened.open(info))
    )


def _tar_member(archive: Path, tar: tarfile.TarFile, info: tarfile.TarInfo) -> _Member:
    if info.type not in (tarfile.REGTYPE, tarfile.AREGTYPE, tarfile.DIRTYPE):
        raise _unsafe(archive, info.name, "is a link, a device or of another unknown kind")
    if info.sparse is not None or info.size < 0:
        raise _unsafe(archive, info.name, "is a sparse file")

    def opened() -> BufferedIOBase:
        stream = tar.extractfile(info)
        if stream is None:
            raise EOFError(f"{info.name!r} cannot be read")
        return cast(BufferedIOBase, stream)

    return _Member(info.name, info.isdir(), info.size if info.isreg() else 0, opened)
