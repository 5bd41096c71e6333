"""Items: fetched, verified, fetched again, and refused."""

from __future__ import annotations

import hashlib
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from bop_archives import BASE, MODELS, mirror, tarred, zipped
from download_server import Server, status, whole
from graspcast.errors import DownloadError, FormatError, GraspcastError, InputError
from graspcast.fetching import catalogue
from graspcast.fetching.catalogue import ITEMS
from graspcast.fetching.fetch import Fetched, fetch, is_offline
from graspcast.fetching.limits import Limits
from graspcast.fetching.store import Store

Get = Callable[..., Fetched]


@pytest.fixture
def get(tmp_path: Path, limits: Limits) -> Get:
    mirror(tmp_path / "mirror")

    def run(name: str = "lmo-models", source: str | None = None, **options: object) -> Fetched:
        source = source or str(tmp_path / "mirror")
        return fetch(name, mirror=source, limits=limits, **options)  # type: ignore[arg-type]

    return run


def contents(folder: Path) -> dict[str, bytes]:
    files = (p for p in folder.rglob("*") if p.is_file())
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in files}


EXPECTED = {k.removeprefix("lmo/"): v for k, v in {**BASE, **MODELS}.items()}


def test_base_and_models_are_one_bop_directory(get: Get, tmp_path: Path) -> None:
    fetched = get()
    assert fetched.path == tmp_path / "cache" / "fetched" / "lmo"
    assert contents(fetched.path) == EXPECTED
    assert [a.new for a in fetched.archives] == [True, True]
    assert [a.files for a in fetched.archives] == [2, 2]
    assert "states no checksum: that of this download is recorded" in fetched.archives[0].remarks[0]
    assert not list((tmp_path / "cache" / "fetched" / "downloads").iterdir())


def test_the_second_time_nothing_is_needed(get: Get, tmp_path: Path) -> None:
    get()
    shutil.rmtree(tmp_path / "mirror")
    assert [a.new for a in get().archives] == [False, False]
    assert [a.new for a in get(offline=True).archives] == [False, False]


def test_items_share_archives(get: Get) -> None:
    get("lmo-models")
    assert [a.new for a in get("lmo").archives] == [False, False, True]
    assert "test/000002/rgb/000003.png" in contents(get("lmo").path)


def test_offline_needs_it_in_the_cache(get: Get, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"lmo_base.zip: is not cached .*nothing is downloaded"):
        get(offline=True)
    assert not (tmp_path / "cache").exists()


def test_the_environment_says_offline(get: Get, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GRASPCAST_OFFLINE", "1")
    assert is_offline()
    with pytest.raises(InputError, match="GRASPCAST_OFFLINE"):
        get()
    monkeypatch.setenv("GRASPCAST_OFFLINE", "0")
    assert not is_offline()


def damage(folder: Path, how: str) -> None:
    mesh = folder / "models" / "obj_000001.ply"
    if how == "changed":
        mesh.write_bytes(mesh.read_bytes()[:-1] + b"X")
    elif how == "missing":
        mesh.unlink()
    elif how == "link":
        mesh.unlink()
        mesh.symlink_to("/etc/passwd")
    else:
        receipt = folder.parent / "receipts" / "lmo_models.zip.json"
        receipt.write_text(receipt.read_text().replace("obj_000001", "obj_000002"))


@pytest.mark.parametrize(
    ("how", "says"),
    [
        ("changed", "has changed since it was fetched"),
        ("missing", "is missing"),
        pytest.param(
            "link",
            "is missing",
            marks=pytest.mark.skipif(
                sys.platform == "win32", reason="links need rights: run it on Linux or macOS"
            ),
        ),
        ("receipt", "is damaged"),
    ],
)
def test_what_is_damaged_is_fetched_again(get: Get, how: str, says: str) -> None:
    folder = get().path
    damage(folder, how)
    with pytest.raises(InputError, match=says):
        get(offline=True)
    assert [a.new for a in get().archives] == [False, True]
    assert contents(folder) == EXPECTED


def test_what_differs_from_the_first_download_is_refused(get: Get, tmp_path: Path) -> None:
    folder = get().path
    mirror(tmp_path / "mirror", models=zipped({**MODELS, "models/obj_000005.ply": b"new"}))
    assert [a.new for a in get().archives] == [False, False]
    damage(folder, "missing")
    with pytest.raises(DownloadError, match="differ from those fetched first") as caught:
        get()
    assert caught.value.parameters == ("again",)
    assert not (folder / "models" / "obj_000005.ply").exists()
    remarks = get(again=True).archives[1].remarks
    assert any("differ from those fetched before" in r for r in remarks)
    assert (folder / "models" / "obj_000005.ply").read_bytes() == b"new"
    assert [a.new for a in get().archives] == [False, False]


HOSTILE = {
    "leaves the folder": zipped({**MODELS, "../../evil": b"x"}),
    "no models": zipped({"other/x": b"x"}),
    "no archive": b"<html>login</html>",
    "empty": b"",
}


@pytest.mark.parametrize("content", HOSTILE.values(), ids=HOSTILE)
def test_what_is_refused_leaves_nothing(get: Get, tmp_path: Path, content: bytes) -> None:
    mirror(tmp_path / "mirror", models=content)
    with pytest.raises(FormatError, match=r"lmo_models.zip"):
        get()
    left = {p.name for p in tmp_path.rglob("*") if p.is_file() and "mirror" not in p.parts}
    assert left <= {"camera.json", "test_targets_bop19.json", "lmo_base.zip.json", "lmo.lock"}
    mirror(tmp_path / "mirror")
    assert contents(get().path) == EXPECTED


def test_an_archive_cannot_replace_what_another_one_holds(get: Get, tmp_path: Path) -> None:
    mirror(tmp_path / "mirror", base=zipped({**BASE, "lmo/models/models_info.json": b"evil"}))
    fetched = get()
    assert contents(fetched.path) == EXPECTED
    assert "not unpacked: models" in fetched.archives[0].remarks


def test_a_refused_renewal_leaves_what_was_there(get: Get, tmp_path: Path) -> None:
    folder = get().path
    mirror(tmp_path / "mirror", models=HOSTILE["leaves the folder"])
    with pytest.raises(FormatError):
        get(again=True)
    assert contents(folder) == EXPECTED
    assert [a.new for a in get(offline=True).archives] == [False, False]


def test_from_a_server(get: Get, server: Server, tmp_path: Path) -> None:
    for path in (tmp_path / "mirror").iterdir():
        server.give(f"bop/{path.name}", whole(path.read_bytes()))
    assert contents(get(source=f"{server.url}/bop/").path) == EXPECTED
    assert "authorization" not in server.asked[0][1]
    assert server.asked[0][1]["accept-encoding"] == "identity"


def test_the_release_is_checked_against_its_git_tree(
    tmp_path: Path, limits: Limits, monkeypatch: pytest.MonkeyPatch
) -> None:
    archive = ITEMS["release"].archives[0]
    source = tmp_path / "mirror"
    source.mkdir()
    (source / archive.name).write_bytes(tarred(("r/Pose-Estimates/a", b"one\n")))
    with pytest.raises(DownloadError, match=f"its git tree is not {archive.git_tree}"):
        fetch("release", mirror=str(source), limits=limits)
    assert not (tmp_path / "cache" / "fetched" / "release").exists()
    # The tree of these files, as git computes it.
    right = replace(archive, git_tree="284bf769791fcbedca8211df289526f4e9789593")
    item = replace(ITEMS["release"], archives=(right,))
    monkeypatch.setitem(catalogue.ITEMS, "release", item)
    fetched = fetch("release", mirror=str(source), limits=limits)
    assert contents(fetched.path) == {"Pose-Estimates/a": b"one\n"}


@pytest.mark.parametrize("name", ["lmo_models", "", "tless", "../lmo"])
def test_unknown_items(name: str) -> None:
    with pytest.raises(GraspcastError, match="unknown item"):
        fetch(name)


def test_a_mirror_without_the_file(get: Get, server: Server, tmp_path: Path) -> None:
    (tmp_path / "mirror" / "lmo_models.zip").unlink()
    with pytest.raises(DownloadError, match="there is no such file in the mirror"):
        get()
    server.give("lmo_base.zip", status(404))
    with pytest.raises(DownloadError, match="404") as caught:
        get(source=server.url, again=True)
    assert caught.value.parameters == ("mirror",)


def test_a_cache_that_cannot_be_written(get: Get, tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("a file")
    with pytest.raises(InputError, match="cache"):
        get()


def test_progress_rises_to_the_end(get: Get) -> None:
    told: list[tuple[float, str]] = []
    get(progress=lambda share, message: told.append((share, message)))
    shares = [share for share, _ in told]
    assert shares == sorted(shares)
    assert shares[-1] == 1
    assert any(m.startswith("lmo_models.zip: ") and " of " in m for _, m in told)


def test_a_cache_that_may_only_be_read_serves(get: Get, tmp_path: Path) -> None:
    get()
    store = Store()
    shutil.rmtree(store.root / "locks")
    (store.root / "locks").write_text("no directory")  # even root cannot lock here
    assert [a.new for a in get().archives] == [False, False]


def test_a_cache_that_cannot_be_written_says_what_to_do(get: Get, tmp_path: Path) -> None:
    root = Store().root
    root.mkdir(parents=True)
    (root / "locks").write_text("no directory")
    with pytest.raises(InputError, match=r"cannot be written .*GRASPCAST_CACHE names another"):
        get()


def test_a_download_that_was_left_is_not_taken_for_new(get: Get, tmp_path: Path) -> None:
    get()
    store, archive = Store(), ITEMS["lmo-models"].archives[1]
    left = store.download(archive)
    left.write_bytes(b"an earlier version")
    assert [a.new for a in get().archives] == [False, False]
    assert not left.exists()
    left.write_bytes(b"an earlier version")
    assert [a.new for a in get(again=True).archives] == [True, True]
    assert contents(store.folder(archive)) == EXPECTED


def test_the_digest_that_a_server_states_is_told(get: Get, server: Server, tmp_path: Path) -> None:
    for path in (tmp_path / "mirror").iterdir():
        content = path.read_bytes()
        stated = hashlib.sha256(content).hexdigest()
        moved = server.give(f"stored/{path.name}", whole(content))
        server.give(f"bop/{path.name}", status(302, Location=moved, X_Linked_ETag=f'"{stated}"'))
    fetched = get(source=f"{server.url}/bop/")
    assert fetched.archives[0].remarks == ("its SHA-256 is the one that the server states",)
