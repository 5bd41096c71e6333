"""Compressed files: gzip is unpacked where text is read; others are named."""

from __future__ import annotations

import codecs
import zlib

__all__ = ["compressed", "gunzipped", "not_text", "utf_16"]

_GZIP = b"\x1f\x8b"
_STARTS = {
    _GZIP: "gzip",
    b"PK\x03\x04": "zip",
    b"BZh": "bzip2",
    b"\xfd7zXZ\x00": "xz",
    b"\x28\xb5\x2f\xfd": "zstd",
    b"PAR1": "Parquet",
}


def compressed(content: bytes) -> str:
    """Say that content is compressed, and what to do, by its first bytes; empty if it is not."""
    for mark, kind in _STARTS.items():
        if content.startswith(mark):
            remedy = "convert" if kind == "Parquet" else "unpack"
            return f"is a {kind} file ({remedy} it first)"
    return ""


def not_text(content: bytes) -> str:
    """Say why content is no UTF-8 text: it is compressed, in another encoding, or no text."""
    return compressed(content) or utf_16(content) or _first_bad_byte(content)


def utf_16(content: bytes) -> str:
    """Say that content is text in UTF-16, and what to do, by its first bytes, or nothing."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "is not UTF-8 text but UTF-16; save it as UTF-8"
    return ""


def _first_bad_byte(content: bytes) -> str:
    try:
        content.decode("utf-8")
    except UnicodeDecodeError as error:
        at = error.start
        line = content.count(b"\n", 0, at) + 1
        return f"is not UTF-8 text (byte 0x{content[at]:02x} in line {line}); save it as UTF-8"
    return "is not UTF-8 text"


def gunzipped(content: bytes, limit: int) -> bytes:
    """Unpack gzip content, by its first bytes; return other content as it is.

    Parameters
    ----------
    content
        The file's content.
    limit
        The most bytes that it may have unpacked.

    Raises
    ------
    ValueError
        Saying what is wrong: it is damaged, or larger than the limit.
    """
    if not content.startswith(_GZIP):
        return content
    parts, size = [], 0
    try:
        while content:  # several gzip streams one after the other are one file
            unpacker = zlib.decompressobj(wbits=16 + zlib.MAX_WBITS)
            parts.append(unpacker.decompress(content, limit - size + 1))
            size += len(parts[-1])
            if size > limit:
                raise ValueError(f"has more than {limit:,} bytes when it is unpacked")
            if not unpacker.eof:
                raise ValueError("is a gzip file that ends too early")
            content = unpacker.unused_data.lstrip(b"\0")
    except zlib.error as error:
        raise ValueError(f"is a damaged gzip file ({error})") from error
    return b"".join(parts)
