import shutil
import sqlite3

import numpy as np
import pytest

from attempt_records import frame
from graspcast.attempt_log import AttemptLog, OutcomeRecord
from graspcast.attempt_log.checking import check_rows
from graspcast.attempt_log.recorded import recorded
from graspcast.errors import FormatError, GraspcastError


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("written") / "log.db"
    with AttemptLog.open(path) as log:
        log.add([frame(i) for i in range(4)])
        for i in range(3):
            log.add_outcome(OutcomeRecord(f"d{i}", True, "held"))
    return path


@pytest.fixture
def changed(written, tmp_path):
    """A connection that may change a copy."""
    shutil.copy(written, tmp_path / "log.db")
    connection = sqlite3.connect(tmp_path / "log.db", isolation_level=None)
    triggers = connection.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'")
    for (name,) in triggers.fetchall():
        connection.execute(f"DROP TRIGGER {name}")
    yield connection
    connection.close()


def test_a_whole_log(written):
    counts = AttemptLog.read(written).check()
    assert counts == {"frame": 4, "decision": 4, "outcome": 3}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("UPDATE outcome SET success = 0 WHERE seq = 2", "outcome 2 is not as it was written"),
        ("UPDATE outcome SET reason = 'x' WHERE seq = 3", "outcome 3 is not as it was written"),
        ("UPDATE decision SET probability = 0.1 WHERE seq = 3", "frame 3 is not as"),
        ("UPDATE estimate SET score = 0.0 WHERE frame = 2", "frame 2 is not as"),
        ("DELETE FROM estimate WHERE frame = 4", "frame 4 is not as"),
        ("DELETE FROM outcome WHERE seq = 2", "lacks 1 rows of its outcomes"),
        ("UPDATE outcome SET decision = 4 WHERE seq = 3", "outcome 3 is not as"),
        ("UPDATE frame SET chain = zeroblob(32) WHERE seq = 1", "frame 1 is not as"),
    ],
)
def test_a_row_that_was_changed_is_named(changed, change, message):
    changed.execute(change)
    with pytest.raises(FormatError, match=message):
        check_rows(changed, "log.db")


def test_a_flipped_bit_is_found(written, tmp_path):
    content = written.read_bytes()
    at = content.index(b"probability 0.900")
    path = tmp_path / "log.db"
    path.write_bytes(content[:at] + b"q" + content[at + 1 :])
    with pytest.raises(FormatError, match="is not as it was written"):
        AttemptLog.read(path).check()


def uses(path):
    yield lambda: AttemptLog.read(path).table()
    yield lambda: AttemptLog.read(path).estimates()
    yield lambda: AttemptLog.read(path).check()
    yield lambda: recorded([AttemptLog.read(path)])
    yield lambda: AttemptLog.open(path).close()


@pytest.mark.parametrize("seed", range(4))
def test_bytes_changed_at_random_are_read_or_refused(written, tmp_path, seed):
    rng = np.random.default_rng(seed)
    content = np.frombuffer(written.read_bytes(), np.uint8)
    refusals = 0
    for number in range(8):
        changed = content.copy()
        at = rng.integers(len(changed) if number % 2 else 4096, size=rng.integers(1, 40))
        changed[at] = rng.integers(256, size=len(at))
        path = tmp_path / f"{number}.db"
        path.write_bytes(changed.tobytes())
        for use in uses(path):
            try:
                use()
            except GraspcastError:
                refusals += 1
    assert refusals > 0


def test_text_that_is_none_and_times_that_are_none_are_told_as_damage(written, tmp_path):
    content = written.read_bytes()
    for number, (before, after) in enumerate(
        (
            (b"2026-03-01T12:00", b"2026-93-01T12:00"),
            (b"probability 0.900", b"\xffrobability 0.900"),
        )
    ):
        path = tmp_path / f"{number}.db"
        path.write_bytes(content.replace(before, after, 1))
        with pytest.raises(FormatError, match="is damaged"):
            AttemptLog.read(path).table()
