"""Trees of git commits."""

from __future__ import annotations

from pathlib import Path

from graspcast.fetching.git_tree import git_tree


def test_the_tree_that_git_computes(tmp_path: Path) -> None:
    """Made by git: folders are ordered as if their names ended in a slash."""
    files = {"a/b": b"one\n", "a.txt": b"two\n", "a0": b""}
    for name, content in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    assert git_tree(tmp_path, files) == "ad87edd72578f7a1df1fb68088684b4f221a5b47"
