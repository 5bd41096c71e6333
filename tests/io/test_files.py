"""Atomic writes: the old content or all of the new."""

from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from graspcast.errors import InputError
from graspcast.io import files
from graspcast.io.files import atomic_write, check_target, sweep, temporary_directory, write_text


def names(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


@given(st.text(st.characters(codec="utf-8", exclude_characters="\r")))
def test_text_is_utf8_with_unix_line_ends(
    tmp_path_factory: pytest.TempPathFactory, text: str
) -> None:
    path = tmp_path_factory.mktemp("files") / "a.txt"
    write_text(path, text)
    assert path.read_bytes() == text.encode()


def test_directories_are_made_and_old_content_replaced(tmp_path: Path) -> None:
    path = tmp_path / "x" / "y" / "a.txt"
    write_text(path, "old and longer")
    write_text(path, "new")
    assert path.read_text() == "new"
    assert names(path.parent) == ["a.txt"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_failure_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, error: type[BaseException]
) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(error, match="half way"), atomic_write(path) as temporary:
        temporary.write_text("ne")
        assert path.read_text() == "old"
        raise error("half way")
    assert path.read_text() == "old"
    assert names(tmp_path) == ["a.txt"]


def test_the_path_has_its_old_content_until_the_end(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with atomic_write(path) as temporary:
        temporary.write_text("new")
        assert temporary.parent == tmp_path
        assert not path.exists()
    assert path.read_text() == "new"


def test_a_full_disk_is_an_input_error(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(InputError, match="could not be written") as caught, atomic_write(path):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert str(caught.value).startswith(f"{path}: ")
    assert "No space left" in str(caught.value)
    assert path.read_text() == "old"
    assert names(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("umask", [0o022, 0o077, 0o002])
def test_permissions_follow_the_umask(tmp_path: Path, umask: int) -> None:
    before = os.umask(umask)
    try:
        write_text(tmp_path / "a.txt", "x")
        assert os.umask(umask) == umask  # left as it was
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == 0o666 & ~umask


def test_where_nothing_can_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match=r"file/a\.txt: cannot be written") as caught:
        write_text(tmp_path / "file" / "a.txt", "x")
    assert caught.value.parameters == ("out",)
    (tmp_path / "directory").mkdir()
    with pytest.raises(InputError, match="directory: is a directory, and would be replaced"):
        write_text(tmp_path / "directory", "x")
    assert names(tmp_path) == ["directory", "file"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere: run it as another user")
def test_a_directory_without_permission(tmp_path: Path) -> None:
    folder = tmp_path / "closed"
    folder.mkdir(mode=0o500)
    with pytest.raises(InputError, match="Permission denied"):
        write_text(folder / "a.txt", "x")


def test_a_killed_process_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    program = textwrap.dedent(
        """
        import os, signal, sys
        from graspcast.io.files import atomic_write
        with atomic_write(sys.argv[1]) as temporary:
            temporary.write_text("half")
            os.kill(os.getpid(), signal.SIGKILL)
        """
    )
    source = str(Path(__file__).parents[2] / "src")
    done = subprocess.run(
        [sys.executable, "-c", program, str(path)],
        env={**os.environ, "PYTHONPATH": source},
        check=False,
    )
    assert done.returncode == -9
    assert path.read_text() == "old"


@pytest.mark.skipif(
    not Path("/dev/null").exists(), reason="needs device files: run it on Linux or macOS"
)
def test_devices_pipes_and_directories_are_not_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for path, kind in (
        (Path("/dev/null"), "not a regular file"),
        (tmp_path / "pipe", "not a regular file"),
        (tmp_path / "folder", "a directory"),
    ):
        with pytest.raises(InputError, match=f"is {kind}, and would be replaced"):
            write_text(path, "text")
    assert Path("/dev/null").is_char_device()


def test_a_symbolic_link_is_followed_and_stays(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "target.txt"
    target.parent.mkdir()
    target.write_text("old")
    (tmp_path / "link").symlink_to(target)
    write_text(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert target.read_text() == "new"
    (tmp_path / "dangling").symlink_to(tmp_path / "made.txt")
    write_text(tmp_path / "dangling", "new")
    assert (tmp_path / "made.txt").read_text() == "new"


KILLED = """
import os, signal, sys, time
from graspcast.io.files import atomic_write, temporary_directory
with temporary_directory(sys.argv[1]) as folder, atomic_write(sys.argv[1] + "/a.txt") as temporary:
    (folder / "b.txt").write_text("half")
    temporary.write_text("half")
    print("ready", flush=True)
    time.sleep(60)
"""


def test_temporary_files_of_a_killed_process_are_swept_by_the_next(tmp_path: Path) -> None:
    source = str(Path(__file__).parents[2] / "src")
    command = [sys.executable, "-c", KILLED, str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": source}
    (tmp_path / ".other-1.tmp").write_text("not ours")
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stdout.readline() == b"ready\n"
        kept = names(tmp_path)
        assert len(kept) == 3
        sweep(tmp_path)
        assert names(tmp_path) == kept  # in use
        process.kill()
    assert names(tmp_path) == kept
    write_text(tmp_path / "c.txt", "new")
    assert names(tmp_path) == [".other-1.tmp", "c.txt"]


def test_a_temporary_directory_goes_with_what_it_holds(tmp_path: Path) -> None:
    with temporary_directory(tmp_path / "made") as folder:
        assert folder.parent == tmp_path / "made"
        write_text(folder / "x" / "a.txt", "x")
    assert names(tmp_path / "made") == []
    (tmp_path / "file").write_text("in the way")
    with (
        pytest.raises(InputError, match=r"file: cannot be written"),
        temporary_directory(tmp_path / "file"),
    ):
        pass


def test_long_names_can_be_written(tmp_path: Path) -> None:
    path = tmp_path / ("n" * 250 + ".txt")
    write_text(path, "x")
    assert path.read_text() == "x"


def test_a_target_is_checked_without_being_made(tmp_path: Path) -> None:
    check_target(tmp_path / "new" / "folder" / "x.csv")
    assert not (tmp_path / "new").exists()
    (tmp_path / "file").write_text("")
    check_target(tmp_path / "file")
    with pytest.raises(InputError, match="is a directory") as caught:
        check_target(tmp_path, "json")
    assert caught.value.parameters == ("json",)
    with pytest.raises(InputError, match="file is no directory"):
        check_target(tmp_path / "file" / "x.csv")


def test_files_are_whole_where_there_are_no_locks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On Windows, that is."""
    monkeypatch.setattr(files, "_LOCKS", False)
    left = tmp_path / ".graspcast-left.tmp"
    left.write_text("of a process that may still live")
    write_text(tmp_path / "a.txt", "old")
    write_text(tmp_path / "a.txt", "new")
    with pytest.raises(ValueError, match="half way"), atomic_write(tmp_path / "a.txt") as temporary:
        temporary.write_text("ne")
        raise ValueError("half way")
    sweep(tmp_path)
    assert names(tmp_path) == [left.name, "a.txt"]
    assert (tmp_path / "a.txt").read_text() == "new"
    with temporary_directory(tmp_path) as folder:
        (folder / "b").write_text("b")
    assert names(tmp_path) == [left.name, "a.txt"]


def test_a_temporary_file_that_another_process_removes_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []

    def make(parent: Path) -> tuple[int, str]:
        handle, name = tempfile.mkstemp(dir=parent)
        made.append(name)
        if len(made) == 1:  # between making and locking
            Path(name).unlink()
        return handle, name

    monkeypatch.setattr(files, "_make_file", make)
    write_text(tmp_path / "a.txt", "text")
    assert len(made) == 2 and names(tmp_path) == ["a.txt"]


def test_a_folder_that_may_not_be_written_to_is_named_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # as for others than root
    with pytest.raises(InputError, match=r"a\.txt: cannot be written \(.* may not be written to"):
        check_target(tmp_path / "a.txt", "out")
