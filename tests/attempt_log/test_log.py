import os
import sqlite3
import subprocess
import sys
import threading
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest

from attempt_records import NOON, decision, frame, pose
from graspcast.attempt_log import AttemptLog, OutcomeRecord, Wanted
from graspcast.attempt_log.log import _Ticket
from graspcast.errors import FormatError, GraspcastError, InputError, MismatchError


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.db"


def fill(path, *outcomes):
    with AttemptLog.open(path) as log:
        log.add([frame(i) for i in range(len(outcomes))])
        for i, success in enumerate(outcomes):
            log.add_outcome(OutcomeRecord(f"d{i}", success))


def test_a_decision_and_its_outcome_come_back(path):
    seen = pose(0.1)
    with AttemptLog.open(path) as log:
        log.add([frame(0, decision(0, cam_T_obj=seen), world_T_cam=pose(2.0), source="node")])
        assert log.add_outcome(OutcomeRecord("d0", False, "slipped", NOON))
    row = AttemptLog.read(path).table().row(0, named=True)
    assert (row["id"], row["object_name"], row["action"]) == ("d0", "ycbv-5", "attempt")
    assert (row["probability"], row["source"], row["model"]) == (0.9, "node", "m" * 64)
    assert (row["success"], row["outcome_reason"]) == (False, "slipped")
    assert row["time_utc"] == row["outcome_time_utc"] == NOON
    np.testing.assert_array_equal(np.frombuffer(row["cam_T_obj"]).reshape(4, 4), seen)


def test_estimates_come_back_as_they_came(path):
    with AttemptLog.open(path) as log:
        log.add([frame(0, estimates={"b": [("ycbv-5", pose(0.2), 0.5)], "a": []})])
        found = log.estimates().row(0, named=True)
        assert log.frames()["estimators"].to_list() == ['["b", "a"]']
    assert (found["estimator"], found["object_name"], found["score"]) == ("b", "ycbv-5", 0.5)
    np.testing.assert_array_equal(np.frombuffer(found["cam_T_obj"]).reshape(4, 4), pose(0.2))


def test_a_reader_sees_what_is_written_while_it_is_written(path):
    with AttemptLog.open(path) as log:
        reader = AttemptLog.read(path)
        assert len(reader.table()) == 0
        log.add([frame(0)])
        assert len(reader.table()) == 1
        log.add([frame(1)])
        assert reader.decisions(after=1)["id"].to_list() == ["d1"]


def test_order_is_the_logs_own_and_not_the_clocks(path):
    with AttemptLog.open(path) as log:
        for i, hours in enumerate((0, -5, 3)):
            log.add([frame(i, time_utc=NOON + timedelta(hours=hours))])
        for i in (2, 0, 1):
            log.add_outcome(OutcomeRecord(f"d{i}", True, time_utc=NOON - timedelta(hours=i)))
        assert log.table()["id"].to_list() == ["d0", "d1", "d2"]
        assert log.outcomes()["decision_id"].to_list() == ["d2", "d0", "d1"]
        assert log.outcomes(after=2)["seq"].to_list() == [3]


def test_the_same_again_is_one_record(path):
    with AttemptLog.open(path) as log:
        log.add([frame(0)])
        log.add([frame(0)])
        assert log.add_outcome(OutcomeRecord("d0", True))
        assert not log.add_outcome(OutcomeRecord("d0", True, "told twice"))
        assert (len(log.table()), len(log.outcomes())) == (1, 1)


def test_what_contradicts_is_refused_and_nothing_changes(path):
    with AttemptLog.open(path) as log:
        log.add([frame(0)])
        log.add_outcome(OutcomeRecord("d0", True))
        with pytest.raises(MismatchError, match="already: it succeeded") as told:
            log.add_outcome(OutcomeRecord("d0", False))
        assert "decision_id" in told.value.parameters
        with pytest.raises(MismatchError, match="decision d0 already"):
            log.add([frame(1), frame(2, decision(0, probability=0.1))])
        assert log.table()["id"].to_list() == ["d0"]
        assert log.outcomes()["success"].to_list() == [True]


def test_outcomes_of_unknown_decisions_and_of_none_are_refused(path):
    with AttemptLog.open(path) as log:
        none = {"action": "abstain", "guide": None, "cam_T_obj": None, "probability": None}
        log.add([frame(0, decision(0, **none), decision(1, action="abstain"))])
        with pytest.raises(InputError, match="no decision 'd7'") as told:
            log.add_outcome(OutcomeRecord("d7", True))
        assert told.value.parameters == ("decision_id",)
        with pytest.raises(MismatchError, match="no pose that could guide"):
            log.add_outcome(OutcomeRecord("d0", True))
        assert log.add_outcome(OutcomeRecord("d1", True))


@pytest.mark.parametrize(
    ("wanted", "ids"),
    [
        (Wanted(objects=["ycbv-9"]), ["d2"]),
        (Wanted(grippers=["robotiq"]), ["d1"]),
        (Wanted(grasps=["side"]), ["d3"]),
        (Wanted(actions=["abstain"]), ["d4"]),
        (Wanted(models=["abc"]), ["d5"]),
        (Wanted(with_outcome=True), ["d0"]),
        (Wanted(with_outcome=False, last=2), ["d4", "d5"]),
        (Wanted(since=NOON + timedelta(seconds=4.5)), ["d5"]),
        (Wanted(until=NOON + timedelta(seconds=1)), ["d0"]),
        (Wanted(after=4), ["d4", "d5"]),
    ],
)
def test_filters(path, wanted, ids):
    changes = (
        {},
        {"gripper": "robotiq"},
        {"object_name": "ycbv-9"},
        {"grasp": "side"},
        {"action": "abstain"},
        {"model": "abcdef"},
    )
    with AttemptLog.open(path) as log:
        for i, changed in enumerate(changes):
            log.add([frame(i, decision(i, **changed), time_utc=NOON + timedelta(seconds=i))])
        log.add_outcome(OutcomeRecord("d0", True))
    assert AttemptLog.read(path).table(wanted)["id"].to_list() == ids


def test_a_second_writer_is_refused_by_name(path):
    with (
        AttemptLog.open(path),
        pytest.raises(InputError, match=f"another process writes .* process {os.getpid()} on "),
    ):
        AttemptLog.open(path)
    AttemptLog.open(path).close()


def test_another_name_of_the_same_file_is_no_second_log(path, tmp_path):
    link = tmp_path / "link.db"
    with AttemptLog.open(path):
        link.symlink_to(path)
        with pytest.raises(InputError, match="another process writes"):
            AttemptLog.open(link)


def test_a_reader_cannot_write(path):
    fill(path, True)
    log = AttemptLog.read(path)
    with pytest.raises(InputError, match="for reading only"):
        log.add([frame(1)])


def test_a_closed_log_refuses(path):
    log = AttemptLog.open(path)
    log.close()
    log.close()
    with pytest.raises(InputError, match="is closed"):
        log.add([frame(1)])


def test_a_fork_cannot_write(path):
    with AttemptLog.open(path) as log:
        child = os.fork()
        if not child:
            try:
                log.add([frame(1)])
            except InputError:
                os._exit(7)
            os._exit(0)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
        log.add([frame(1)])
    assert len(AttemptLog.read(path).table()) == 1


def test_threads_share_a_log_and_one_that_is_refused_spoils_no_other(path):
    errors = []

    def write(log, thread):
        for i in range(20):
            log.add([frame(100 * thread + i)])
            name = f"nothing {i}" if thread == 1 else f"d{100 * thread + i}"
            try:
                log.add_outcome(OutcomeRecord(name, True))
            except InputError as error:
                errors.append(str(error))

    with AttemptLog.open(path) as log:
        threads = [threading.Thread(target=write, args=(log, n)) for n in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert (len(log.table()), len(log.outcomes()), len(errors)) == (80, 60, 20)
        assert sorted(log.outcomes()["seq"]) == list(range(1, 61))


def test_a_thread_that_is_interrupted_interrupts_no_other(path):
    def interrupted(connection):
        raise KeyboardInterrupt

    with AttemptLog.open(path) as log:
        ticket = _Ticket(lambda connection: 1)
        with log._commit, pytest.raises(KeyboardInterrupt):
            log._commit_all([ticket, _Ticket(interrupted)])
        assert isinstance(ticket.error, InputError)
        log.add([frame(0)])
        assert len(log.table()) == 1


@pytest.mark.parametrize("change", ["UPDATE outcome SET success = 0", "DELETE FROM decision"])
def test_other_programs_cannot_change_it_either(path, change):
    fill(path, True)
    with sqlite3.connect(path) as other, pytest.raises(sqlite3.IntegrityError, match="append-only"):
        other.execute(change)


def read(path):
    return AttemptLog.read(path).table()


@pytest.mark.parametrize("use", [AttemptLog.open, read])
class TestFilesThatAreNoLog:
    def test_text(self, path, use):
        path.write_text("estimator,dataset\n" * 100)
        with pytest.raises(FormatError, match="is no attempt log"):
            use(path)
        assert path.read_text().startswith("estimator")

    def test_of_another_program(self, path, use):
        with sqlite3.connect(path) as other:
            other.execute("CREATE TABLE album (title)")
        with pytest.raises(FormatError, match="of another program"):
            use(path)

    def test_newer(self, path, use):
        fill(path, True)
        with sqlite3.connect(path) as other:
            other.execute("PRAGMA user_version = 9")
        with pytest.raises(FormatError, match=r"version 9, .*update graspcast"):
            use(path)

    def test_changed_schema(self, path, use):
        fill(path, True)
        with sqlite3.connect(path) as other:
            other.execute("DROP TRIGGER outcome_no_update")
        with pytest.raises(FormatError, match="changed by another program: the triggers"):
            use(path)

    def test_directory(self, path, use):
        path.mkdir()
        with pytest.raises(InputError, match="is a directory"):
            use(path)

    def test_pipe(self, path, use):
        os.mkfifo(path)
        with pytest.raises(InputError, match="no regular file"):
            use(path)

    def test_truncated(self, path, use):
        fill(path, *[True] * 50)
        os.truncate(path, path.stat().st_size // 2)
        with pytest.raises(FormatError, match="damaged"):
            use(path)

    def test_overwritten_in_the_middle(self, path, use):
        fill(path, *[True] * 50)
        with path.open("r+b") as stream:
            stream.seek(4096)
            stream.write(b"\xff" * (path.stat().st_size - 4096))
        with pytest.raises(FormatError, match="damaged"):
            use(path)


def test_reading_where_there_is_nothing(path):
    with pytest.raises(InputError, match="there is no attempt log"):
        AttemptLog.read(path)
    path.touch()
    with pytest.raises(InputError, match="is empty"):
        AttemptLog.read(path)
    with AttemptLog.open(path) as log:
        log.add([frame(0)])


def test_a_kill_before_the_tables_were_made_is_a_new_log(path):
    sqlite3.connect(path).execute("PRAGMA journal_mode = WAL").connection.close()
    with pytest.raises(FormatError, match="holds no log yet"):
        AttemptLog.read(path)
    AttemptLog.open(path).close()
    assert len(read(path)) == 0


def test_a_full_disk_is_told_and_the_log_goes_on_when_there_is_room(path):
    with AttemptLog.open(path) as log:
        log.add([frame(0)])
        pages = log._connection.execute("PRAGMA page_count").fetchone()[0]
        log._connection.execute(f"PRAGMA max_page_count = {pages + 2}")
        with pytest.raises(InputError, match=r"disk is full; .* is not recorded"):
            log.add([frame(i) for i in range(1, 200)])
        assert len(log.table()) == 1
        log._connection.execute("PRAGMA max_page_count = 1000000")
        log.add([frame(i) for i in range(1, 200)])
        assert len(log.table()) == 200


_LIMITED = """
import resource, sys
from attempt_records import frame
from graspcast.attempt_log import AttemptLog
from graspcast.errors import GraspcastError
log = AttemptLog.open(sys.argv[1])
log.add([frame(0)])
resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, resource.RLIM_INFINITY))
done = 1
try:
    for i in range(1, 1000):
        log.add([frame(i)])
        done += 1
except GraspcastError as error:
    print(done, error)
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
log.add([frame(i) for i in range(done, 1000)])
"""


@pytest.mark.slow
def test_a_limit_on_the_size_of_files_is_a_full_disk(path):
    here = str(Path(__file__).parents[1])
    paths = os.pathsep.join([here, *sys.path])
    out = subprocess.run(
        [sys.executable, "-c", _LIMITED, path],
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert 1 < int(out.split()[0]) < 1000
    assert "not recorded, all before it is" in out
    assert read(path)["id"].to_list() == [f"d{i}" for i in range(1000)]


def test_a_program_that_holds_the_file_is_named_as_the_cause(path, monkeypatch):
    fill(path, True)
    monkeypatch.setattr("graspcast.attempt_log.database._BUSY_S", 0.01)
    other = sqlite3.connect(path)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(InputError, match="locked by another program"):
        AttemptLog.open(path)
    other.close()
    AttemptLog.open(path).close()


@pytest.mark.ill_typed
@pytest.mark.parametrize("path", [None, 3, b"log.db"])
def test_a_path_is_text_or_a_path(path):
    with pytest.raises(GraspcastError):
        AttemptLog.open(path)
