import sqlite3

import pytest

from graspcast.attempt_log.schema import STATEMENTS


@pytest.fixture
def empty():
    connection = sqlite3.connect(":memory:")
    for statement in STATEMENTS:
        connection.execute(statement)
    yield connection
    connection.close()


@pytest.mark.parametrize(
    ("column", "value"),
    [("success", 2), ("success", None), ("digest", b"short"), ("decision", None)],
)
def test_values_that_cannot_be_are_refused(empty, column, value):
    row = {
        "decision": 1,
        "decisions": 1,
        "success": 1,
        "time_utc": "",
        "digest": bytes(32),
        "chain": bytes(32),
    }
    row[column] = value
    with pytest.raises(sqlite3.IntegrityError):
        empty.execute(
            f"INSERT INTO outcome ({', '.join(row)}) VALUES (?, ?, ?, ?, ?, ?)", tuple(row.values())
        )


def test_a_row_is_never_changed(empty):
    empty.execute("INSERT INTO writer VALUES (1, 2, 'host', '1', '')")
    for change in ("UPDATE writer SET pid = 3", "DELETE FROM writer"):
        with pytest.raises(sqlite3.IntegrityError, match="append-only"):
            empty.execute(change)
