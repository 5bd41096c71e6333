"""Archives: unpacked, and refused where they are damaged or hostile."""

from __future__ import annotations

import gzip
import hashlib
import io
import stat
import struct
import tarfile
import zipfile
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest

from bop_archives import MODELS, tarred, zipped
from graspcast.errors import FormatError, InputError
from graspcast.fetching.archives import Unpacked, unpack
from graspcast.fetching.limits import Limits


def open_up(
    tmp_path: Path, content: bytes, kind: str = "zip", *, root: str = "lmo", **changed: float
) -> Unpacked:
    archive, into = tmp_path / f"a.{kind}", tmp_path / "into"
    archive.write_bytes(content)
    into.mkdir()
    limits = replace(Limits(), **changed)  # type: ignore[arg-type]
    return unpack(archive, into, root=root, takes=("*",), limits=limits, unpacked=lambda _: None)


def refusal(tmp_path: Path, content: bytes, kind: str = "zip", **changed: float) -> str:
    """The message; nothing was written outside the folder."""
    with pytest.raises(FormatError) as caught:
        open_up(tmp_path, content, kind, **changed)
    assert {p.name for p in tmp_path.iterdir()} == {f"a.{kind}", "into"}
    return str(caught.value)


@pytest.mark.parametrize("pack", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_a_zip_file(tmp_path: Path, pack: int) -> None:
    found = open_up(tmp_path, zipped({**MODELS, "empty/": b""}, pack=pack))
    for name, content in MODELS.items():
        assert (tmp_path / "into" / name).read_bytes() == content
        assert found.files[name] == (len(content), hashlib.sha256(content).hexdigest())
    assert (tmp_path / "into" / "empty").is_dir()


def test_a_root_is_left_out_where_it_is_the_datasets(tmp_path: Path) -> None:
    found = open_up(tmp_path, zipped({"lmo/a": b"1", "b/lmo": b"2"}))
    assert set(found.files) == {"a", "b/lmo"}


def test_a_tar_file_and_its_only_root(tmp_path: Path) -> None:
    found = open_up(tmp_path, tarred(("r-1/a", b"1"), ("r-1/b/c", b"2")), "tar.gz", root="*")
    assert set(found.files) == {"a", "b/c"}
    assert (tmp_path / "into" / "b" / "c").read_bytes() == b"2"


def test_several_roots_are_refused(tmp_path: Path) -> None:
    content = tarred(("r-1/a", b"1"), ("r-2/b", b"2"))
    with pytest.raises(FormatError, match="the member 'r-2/b': lies outside"):
        open_up(tmp_path, content, "tar.gz", root="*")


def test_what_is_not_asked_for_is_left_out(tmp_path: Path) -> None:
    (tmp_path / "a.zip").write_bytes(zipped({"models/a": b"1", "test/b": b"2"}))
    found = unpack(
        tmp_path / "a.zip",
        tmp_path / "into",
        root="lmo",
        takes=("models*",),
        limits=Limits(),
        unpacked=lambda _: None,
    )
    assert (set(found.files), found.left_out) == ({"models/a"}, ["test"])


NAMES = ["../x", "/tmp/x", "C:\\x", "a/../../x", "models/nul.ply", "..\\x"]


@pytest.mark.parametrize("name", NAMES)
def test_names_that_leave_the_folder(tmp_path: Path, name: str) -> None:
    for kind, content in (("zip", zipped({name: b"x"})), ("tar.gz", tarred((name, b"x")))):
        (tmp_path / kind).mkdir()
        told = refusal(tmp_path / kind, content, kind)
        assert f"the member {name!r}" in told
        assert "not safe to unpack, and nothing of it was" in told


@pytest.mark.parametrize("names", [("a", "A"), ("a/b", "a"), ("x", "x")])
@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_colliding_names(tmp_path: Path, names: tuple[str, str]) -> None:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name in names:
            archive.writestr(name, b"1")
    assert "not safe" in refusal(tmp_path, out.getvalue())


@pytest.mark.parametrize(
    "kind",
    [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.CHRTYPE, tarfile.BLKTYPE, tarfile.FIFOTYPE, b"S"],
)
def test_links_and_devices_in_tar(tmp_path: Path, kind: bytes) -> None:
    info = tarfile.TarInfo("models")
    info.type, info.linkname = kind, "/etc"
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w:gz", format=tarfile.GNU_FORMAT) as archive:
        archive.addfile(info)
    assert "the member 'models'" in refusal(tmp_path, out.getvalue(), "tar.gz")


@pytest.mark.parametrize("mode", [stat.S_IFLNK, stat.S_IFCHR, stat.S_IFIFO])
def test_links_and_devices_in_zip(tmp_path: Path, mode: int) -> None:
    info = zipfile.ZipInfo("models")
    info.create_system, info.external_attr = 3, (mode | 0o777) << 16
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr(info, "/etc")
    assert "is a link or a device" in refusal(tmp_path, out.getvalue())


def test_an_encrypted_member(tmp_path: Path) -> None:
    content = bytearray(zipped({"a": b"1"}))
    for signature, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        content[content.index(signature) + offset] |= 1
    assert "is encrypted" in refusal(tmp_path, bytes(content))


@pytest.mark.parametrize("kind", ["zip", "tar.gz"])
def test_bombs(tmp_path: Path, kind: str) -> None:
    big = bytes(1_000_000)
    content = zipped({"a": big}, pack=zipfile.ZIP_DEFLATED) if kind == "zip" else tarred(("a", big))
    (tmp_path / "1").mkdir()
    told = refusal(tmp_path / "1", content, kind, ratio=100.0, ratio_from=1000)
    assert "as in a bomb" in told
    (tmp_path / "2").mkdir()
    told = refusal(tmp_path / "2", content, kind, unpacked_bytes=10_000)
    assert "unpacks to more than 10 kB" in told
    many = {str(i): b"" for i in range(20)}
    content = zipped(many) if kind == "zip" else tarred(*many.items())
    (tmp_path / "3").mkdir()
    assert "more than 10 members" in refusal(tmp_path / "3", content, kind, members=10)


def test_a_tar_header_that_claims_to_be_large(tmp_path: Path) -> None:
    """Headers of long names are read into memory at once."""
    info = tarfile.TarInfo("././@LongLink")
    info.type, info.size = tarfile.GNUTYPE_LONGNAME, 2**30
    content = gzip.compress(info.tobuf(tarfile.GNU_FORMAT) + bytes(10_000))
    assert "a header is larger than 16 MB" in refusal(tmp_path, content, "tar.gz")


def test_a_member_that_lies_about_its_size(tmp_path: Path) -> None:
    content = bytearray(zipped({"a": b"0" * 1000}, pack=zipfile.ZIP_DEFLATED))
    struct.pack_into("<I", content, content.index(b"PK\x01\x02") + 24, 10)
    assert "a.zip: is damaged" in refusal(tmp_path, bytes(content))


@pytest.mark.parametrize(
    ("kind", "content"),
    [
        ("zip", b""),
        ("zip", b"PK\x05\x06"),
        ("zip", zipped(MODELS)[:-30]),
        ("zip", zipped(MODELS).replace(b"ply\nply", b"plyXply", 1)),
        ("tar.gz", b""),
        ("tar.gz", b"not packed"),
        ("tar.gz", tarred(("a", bytes(range(256)) * 50))[:-20]),
        ("tar.gz", gzip.compress(b"not a tar file" * 100, mtime=0)),
    ],
)
def test_damaged_archives(tmp_path: Path, kind: str, content: bytes) -> None:
    told = refusal(tmp_path, content, kind)
    assert told.startswith(f"a.{kind}: is damaged or no archive")
    assert told.endswith("download it again")


def test_a_web_page_is_named(tmp_path: Path) -> None:
    assert "is a web page" in refusal(tmp_path, b"\n<!DOCTYPE html><title>Login</title>")


def test_every_cut_and_many_changes_are_refused_or_read(tmp_path: Path) -> None:
    whole = zipped({"a": b"1" * 50, "b/c": b"2" * 50}, pack=zipfile.ZIP_DEFLATED)
    for kind, content in (("zip", whole), ("tar.gz", tarred(("a", b"1" * 50)))):
        for at in range(0, len(content), 3):
            changed = content[:at] + b"\xff" + content[at + 1 :]
            for number, bad in enumerate((content[:at], changed)):
                folder = tmp_path / f"{kind}-{at}-{number}"
                folder.mkdir()
                with suppress(FormatError):
                    open_up(folder, bad, kind)
                assert {p.name for p in folder.iterdir()} == {f"a.{kind}", "into"}


def test_permissions_are_not_taken_over(tmp_path: Path) -> None:
    info = tarfile.TarInfo("a")
    info.mode = 0o7777
    open_up(tmp_path, tarred(info), "tar.gz")
    assert not (tmp_path / "into" / "a").stat().st_mode & 0o7111


def test_a_full_disk_is_told_before(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="are free"):
        open_up(tmp_path, zipped(MODELS), spare_bytes=10**18)


def test_the_folder_of_the_root_itself_is_nothing(tmp_path: Path) -> None:
    folder = tarfile.TarInfo("r-1")
    folder.type = tarfile.DIRTYPE
    found = open_up(tmp_path, tarred(folder, ("r-1/a", b"1")), "tar.gz", root="*")
    assert set(found.files) == {"a"}


def test_a_sparse_file_in_tar(tmp_path: Path) -> None:
    """A few bytes that would be written as a gigabyte of zeros."""
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w:gz", format=tarfile.PAX_FORMAT) as archive:
        info = tarfile.TarInfo("lmo/a")
        info.pax_headers = {"GNU.sparse.map": "0,1", "GNU.sparse.size": str(2**30)}
        info.size = 1
        archive.addfile(info, io.BytesIO(b"1"))
    assert "the member 'lmo/a': is a sparse file" in refusal(tmp_path, out.getvalue(), "tar.gz")
