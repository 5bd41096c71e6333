import pytest

from attempt_records import frame
from graspcast.attempt_log import AttemptLog
from graspcast.attempt_log.copying import copy_log
from graspcast.errors import InputError


def test_a_copy_of_a_log_that_is_being_written(tmp_path):
    copy = tmp_path / "copy.db"
    with AttemptLog.open(tmp_path / "log.db") as log:
        log.add([frame(0), frame(1)])
        copy_log(log, copy)
        log.add([frame(2)])
    assert [p.name for p in tmp_path.glob("copy*")] == ["copy.db"]
    assert AttemptLog.read(copy).table()["id"].to_list() == ["d0", "d1"]
    assert AttemptLog.read(copy).check()["frame"] == 2
    with AttemptLog.open(copy) as log:
        log.add([frame(2)])


def test_a_copy_that_cannot_be_written(tmp_path):
    AttemptLog.open(tmp_path / "log.db").close()
    with pytest.raises(InputError, match="is a directory"):
        copy_log(AttemptLog.read(tmp_path / "log.db"), tmp_path)
