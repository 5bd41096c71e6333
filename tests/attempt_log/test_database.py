import os
import subprocess

import pytest

from attempt_records import frame
from graspcast.attempt_log import AttemptLog
from graspcast.attempt_log.database import check_file, connect_reading
from graspcast.errors import InputError


def test_a_missing_file_may_become_a_log(tmp_path):
    check_file(tmp_path / "log.db", there=False)
    with pytest.raises(InputError, match="there is no attempt log"):
        check_file(tmp_path / "log.db", there=True)


@pytest.mark.parametrize("kind", ["nfs4", "cifs", "fuse.sshfs"])
def test_network_file_systems_are_refused(tmp_path, monkeypatch, kind):
    mounts = tmp_path / "mounts"
    mounts.write_text(f"disk / ext4 rw 0 0\nserver:/x {tmp_path} {kind} rw 0 0\n")
    real = os.fspath(mounts)
    monkeypatch.setattr("graspcast.attempt_log.database._MOUNTS", real)
    with pytest.raises(InputError, match=f"network file system .{kind}."):
        AttemptLog.open(tmp_path / "log.db")


def test_a_name_with_signs_of_a_uri(tmp_path):
    path = tmp_path / "a?mode=rw#%41 é.db"
    with AttemptLog.open(path) as log:
        log.add([frame(0)])
    connection = connect_reading(path)
    assert connection.execute("SELECT count(*) FROM decision").fetchone() == (1,)
    connection.close()


def _mount(folder, size):
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder], capture_output=True
    )
    if done.returncode:
        pytest.skip("no file system may be mounted here")


@pytest.fixture
def small_disk(tmp_path):
    folder = tmp_path / "disk"
    folder.mkdir()
    _mount(folder, "512k")
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)


def test_a_disk_that_is_really_full(small_disk):
    ballast = small_disk / "ballast"
    path = small_disk / "log.db"
    with AttemptLog.open(path) as log:
        ballast.write_bytes(bytes(150_000))
        done = 0
        with pytest.raises(InputError, match=r"disk is full|disk failed"):
            for done in range(1000):
                log.add([frame(done)])
        assert log.table()["id"].to_list() == [f"d{i}" for i in range(done)]
        ballast.unlink()
        log.add([frame(done)])
    assert len(AttemptLog.read(path).table()) == done + 1


def test_a_log_on_a_read_only_disk_can_be_read(small_disk):
    path = small_disk / "log.db"
    with AttemptLog.open(path) as log:
        log.add([frame(0)])
    subprocess.run(["mount", "-o", "remount,ro", small_disk], check=True)
    assert len(AttemptLog.read(path).table()) == 1
    with pytest.raises(InputError, match="cannot be written"):
        AttemptLog.open(path)


def test_an_unfinished_log_on_a_read_only_disk_is_told(small_disk):
    path = small_disk / "log.db"
    log = AttemptLog.open(path)
    log.add([frame(0)])
    for name in ("log.db", "log.db-wal"):
        (small_disk / name.replace("log", "other")).write_bytes((small_disk / name).read_bytes())
    log.close()
    subprocess.run(["mount", "-o", "remount,ro", small_disk], check=True)
    with pytest.raises(InputError, match=r"other\.db-wal beside it holds records too"):
        AttemptLog.read(small_disk / "other.db")


def test_a_path_that_cannot_be_looked_at_is_told(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        check_file(tmp_path / ("a" * 300), there=True)


def test_without_a_list_of_mounts_nothing_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("graspcast.attempt_log.database._MOUNTS", str(tmp_path / "none"))
    with AttemptLog.open(tmp_path / "log.db") as log:
        assert repr(log) == f"AttemptLog('{tmp_path / 'log.db'}', writer)"
    assert repr(AttemptLog.read(tmp_path / "log.db")).endswith(", reader)")
