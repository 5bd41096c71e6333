"""SHA-256 digests, against known values."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from graspcast.io.hashing import canonical_json, sha256, sha256_of_file

ABC = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"  # FIPS 180-2, B.1


def test_parts_are_hashed_as_one(tmp_path: Path) -> None:
    assert sha256("abc") == ABC
    assert sha256(b"a", "b", np.array([99], dtype=np.uint8)) == ABC
    (tmp_path / "file").write_bytes(b"abc")
    assert sha256_of_file(tmp_path / "file") == ABC


def test_an_array_is_hashed_in_row_major_order() -> None:
    table = np.arange(6.0).reshape(2, 3)
    assert sha256(np.asfortranarray(table)) == sha256(table) == sha256(table.tobytes())
    assert sha256(table.T) != sha256(table)
    assert sha256(table.astype(np.float32)) != sha256(table)


def test_equal_values_give_equal_json() -> None:
    assert canonical_json({"b": 1, "a": [1.5, "x"]}) == '{"a": [1.5, "x"], "b": 1}'
