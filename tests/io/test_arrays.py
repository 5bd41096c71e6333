"""npz files: what comes back is what was written, or an error."""

from __future__ import annotations

import io
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy import ndarray
from numpy.testing import assert_array_equal

from graspcast.errors import FormatError, InputError
from graspcast.io.arrays import read_arrays, write_arrays

ARRAYS: dict[str, ndarray] = {
    "a/numbers": np.arange(60, dtype=np.float64).reshape(3, 20) / 7,
    "flags": np.array([True, False]),
    "none": np.zeros((0, 4, 4)),
    "one": np.array(3, dtype=np.int32),
    "text": np.array(["lmo-1", "ycbv-20"]),
    "columns": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
}


def npy(array: Any, **options: Any) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, np.asanyarray(array), **options)
    return stream.getvalue()


def archive(path: Path, *members: tuple[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", method) as out:
        for name, content in members:
            out.writestr(name, content)
    return path


@pytest.mark.parametrize("compress", [True, False])
def test_arrays_come_back(tmp_path: Path, compress: bool) -> None:
    write_arrays(tmp_path / "a.npz", ARRAYS, compress=compress)
    found = read_arrays(tmp_path / "a.npz", "make it again")
    assert list(found) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert_array_equal(found[name], array)
        assert (found[name].dtype, found[name].shape) == (array.dtype, array.shape)
        assert found[name].flags.writeable


@pytest.mark.parametrize("compress", [True, False])
def test_a_flipped_bit_is_refused_or_changes_nothing(tmp_path: Path, compress: bool) -> None:
    path = tmp_path / "a.npz"
    write_arrays(path, ARRAYS, compress=compress)
    content, random = path.read_bytes(), np.random.default_rng(0)
    refused = 0
    for place in random.integers(0, 8 * len(content), 600).tolist():
        changed = bytearray(content)
        changed[place // 8] ^= 1 << place % 8
        path.write_bytes(changed)
        try:
            found = read_arrays(path, "make it again")
        except FormatError:
            refused += 1
            continue
        assert list(found) == list(ARRAYS)
        for name, array in ARRAYS.items():
            assert_array_equal(found[name], array)
    assert refused > 400


def test_without_a_digest_or_with_another_it_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, x=np.zeros(3))
    with pytest.raises(FormatError, match=r"has no digest: .*former version.*; make it again"):
        read_arrays(path, "make it again")
    assert_array_equal(read_arrays(path, "", digest=False)["x"], np.zeros(3))
    np.savez(path, x=np.zeros(3), sha256=np.array("0" * 64))
    with pytest.raises(FormatError, match="do not match its digest; make it again"):
        read_arrays(path, "make it again")
    np.savez(path, x=np.zeros(3), sha256=np.zeros(64))
    with pytest.raises(FormatError, match="do not match its digest"):
        read_arrays(path, "make it again")


def test_a_small_file_that_unpacks_to_a_large_one_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez_compressed(path, x=np.zeros(2_000_000), y=np.zeros(2_000_000))
    assert path.stat().st_size < 100_000
    with pytest.raises(FormatError, match="more than the 30,000,000 that are read"):
        read_arrays(path, "", digest=False, limit=30_000_000)
    assert len(read_arrays(path, "", digest=False)) == 2


def test_what_is_no_plain_array_is_refused(tmp_path: Path) -> None:
    path, good = tmp_path / "a.npz", npy(np.zeros(3))
    huge = npy(np.zeros(3)).replace(b"(3,)", b"(3000000,)"[:10]).replace(b"(3,), }", b"(9,), }")
    for members, says in (
        ([("x.npy", good), ("readme.txt", b"")], "is no array"),
        ([("x.npy", npy(np.array([{}]), allow_pickle=True))], "holds object"),
        ([("x.npy", npy(np.zeros(2, dtype=[("a", "f8")])))], "holds"),
        ([("x.npy", good[:-1])], "does not have the 24 bytes"),
        ([("x.npy", good + b"0")], "does not have the 24 bytes"),
        ([("x.npy", huge)], "x.npy"),
        ([("x.npy", npy(np.zeros(3), version=(3, 0)))], "npy version"),
        ([("x.npy", b"text")], "not a complete npz"),
        ([], "holds no arrays"),
    ):
        with pytest.raises(FormatError, match=says):
            read_arrays(archive(path, *members), "make it again", digest=False)
    with pytest.raises(FormatError, match="compressed in an unusual way"):
        read_arrays(archive(path, ("x.npy", good), method=zipfile.ZIP_BZIP2), "", digest=False)
    with pytest.warns(UserWarning, match="Duplicate"):
        archive(path, ("x.npy", good), ("x.npy", good))
    with pytest.raises(FormatError, match="'x' is there twice"):
        read_arrays(path, "", digest=False)


def test_objects_are_not_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="x holds objects"):
        write_arrays(tmp_path / "a.npz", {"x": np.array([{}])})
    assert not list(tmp_path.iterdir())


def test_a_file_holds_the_arrays_and_their_digest_alone(tmp_path: Path) -> None:
    write_arrays(tmp_path / "a.npz", ARRAYS)
    with np.load(tmp_path / "a.npz") as file:
        assert set(file.files) == {*ARRAYS, "sha256"}


def test_an_array_that_the_archive_says_is_longer_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    whole = npy(np.zeros(3))
    archive(path, ("x.npy", whole[:-8]))
    shorter = struct.pack("<I", len(whole) - 8)
    # The unpacked size stands in the file's own header and in the list at the end.
    assert path.read_bytes().count(shorter) == 2
    path.write_bytes(path.read_bytes().replace(shorter, struct.pack("<I", len(whole))))
    with pytest.raises(FormatError, match=r"x\.npy is cut off"):
        read_arrays(path, "make it again", digest=False)
