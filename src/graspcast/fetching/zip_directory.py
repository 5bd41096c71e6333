"""The directory of a zip file: its size is checked before all of it is read into memory."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

__all__ = ["check_directory"]

_END, _END_SIZE = b"PK\x05\x06", 22
_LOCATOR, _LOCATOR_SIZE = b"PK\x06\x07", 20
_LONGEST_COMMENT = 65_535
_BYTES_A_MEMBER = 512


def check_directory(archive: Path, members: int) -> None:
    """Raise where a zip file's directory is too large for so many members.

    Parameters
    ----------
    archive
        The file.
    members
        Most members.

    Raises
    ------
    zipfile.BadZipFile
        If it is too large, or the file has none.
    """
    size = archive.stat().st_size
    with archive.open("rb") as stream:
        stream.seek(max(0, size - _END_SIZE - _LONGEST_COMMENT - _LOCATOR_SIZE))
        tail = stream.read()
        at = tail.rfind(_END)
        if at < 0 or len(tail) - at < _END_SIZE:
            raise zipfile.BadZipFile("it has no directory: its end is missing")
        directory = struct.unpack_from("<I", tail, at + 12)[0]
        locator = at - _LOCATOR_SIZE
        if locator >= 0 and tail[locator : locator + 4] == _LOCATOR:
            place = struct.unpack_from("<Q", tail, locator + 8)[0]
            # Where something stands before the archive, the record is right before the locator.
            before = size - len(tail) + locator - 56
            for position in (place, before):
                if 0 <= position <= size - 56:
                    stream.seek(position)
                    record = stream.read(56)
                    if record[:4] == b"PK\x06\x06":
                        directory = max(
                            directory % (2**32 - 1), struct.unpack_from("<Q", record, 40)[0]
                        )
    if directory > members * _BYTES_A_MEMBER:
        raise zipfile.BadZipFile(f"its directory has {directory:,} bytes, too many")
