"""Compressed files given where plain ones are read."""

from __future__ import annotations

__all__ = ["compressed", "not_text"]

_STARTS = {
    b"\x1f\x8b": "gzip",
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
    """Say why content is no UTF-8 text: it is compressed, or something else."""
    return compressed(content) or "is not UTF-8 text"
