"""A stream for reading tar files, of limited length, from which no read is large."""

from __future__ import annotations

from io import BufferedIOBase

__all__ = ["BoundedStream", "OversizeError"]

_MOST_AT_ONCE = 1 << 24


class OversizeError(Exception):
    """More was to be read than is allowed; the text says what."""


class BoundedStream:
    """A stream of limited length.

    ``tarfile`` reads the headers of long names into memory at once, however large they claim to be.

    Parameters
    ----------
    stream
        What is read.
    most
        How many bytes may be read or skipped.
    """

    def __init__(self, stream: BufferedIOBase, most: int):
        self._stream, self._most = stream, most

    def read(self, size: int = -1) -> bytes:
        """Read bytes."""
        if not 0 <= size <= _MOST_AT_ONCE:
            raise OversizeError("a header is larger than 16 MB")
        self._check(self._stream.tell() + size)
        return self._stream.read(size)

    def seek(self, position: int, whence: int = 0) -> int:
        """Go to a position, from the start."""
        if whence:
            raise OversizeError("it cannot be read from the end")
        self._check(position)
        return self._stream.seek(position)

    def tell(self) -> int:
        """Return the position."""
        return self._stream.tell()

    def _check(self, position: int) -> None:
        if position > self._most:
            raise OversizeError(f"it unpacks to more than {self._most / 1e9:.3g} GB")
