"""Compressed files given where plain ones are read."""

from __future__ import annotations

__all__ = ["not_text"]

_STARTS = {
    b"\x1f\x8b": "gzip",
    b"PK\x03\x04": "zip",
    b"BZh": "bzip2",
    b"\xfd7zXZ\x00": "xz",
    b"\x28\xb5\x2f\xfd": "zstd",
    b"PAR1": "Parquet",
}


def not_text(content: bytes) -> str:
    """Say why content is no UTF-8 text, by its first bytes: it is compressed, or something else."""
    for mark, kind in _STARTS.items():
        if content.startswith(mark):
            remedy = "convert" if kind == "Parquet" else "unpack"
            return f"is a {kind} file ({remedy} it first)"
    return "is not UTF-8 text"
