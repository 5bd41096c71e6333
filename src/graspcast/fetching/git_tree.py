"""The tree of a git commit, computed from files: equal trees are equal contents."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

__all__ = ["git_tree"]


def git_tree(folder: Path, files: Iterable[str]) -> str:
    """Compute the SHA-1 of the git tree of files, none of them executable.

    Parameters
    ----------
    folder
        Where they are.
    files
        Their paths in it, with slashes.
    """
    tree: dict[str, object] = {}
    for path in files:
        *folders, name = path.split("/")
        level = tree
        for part in folders:
            level = level.setdefault(part, {})  # type: ignore[assignment]
        level[name] = _object(b"blob", (folder / path).read_bytes())
    return _tree(tree).hex()


def _object(kind: bytes, content: bytes) -> bytes:
    header = kind + f" {len(content)}".encode() + b"\0"
    return hashlib.sha1(header + content, usedforsecurity=False).digest()


def _tree(level: dict[str, object]) -> bytes:
    rows = []
    for name, entry in level.items():
        is_tree = isinstance(entry, dict)
        digest = _tree(entry) if isinstance(entry, dict) else entry
        mode = b"40000" if is_tree else b"100644"
        order = name.encode() + (b"/" if is_tree else b"")
        rows.append((order, mode + b" " + name.encode() + b"\0" + digest))  # type: ignore[operator]
    return _object(b"tree", b"".join(row for _, row in sorted(rows)))
