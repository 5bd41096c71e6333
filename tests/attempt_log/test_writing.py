import sqlite3

import pytest

from attempt_records import frame
from graspcast.attempt_log import OutcomeRecord
from graspcast.attempt_log.rows import FIRST_CHAIN, chained
from graspcast.attempt_log.schema import STATEMENTS
from graspcast.attempt_log.writing import insert_frame, insert_outcome


@pytest.fixture
def empty():
    connection = sqlite3.connect(":memory:")
    for statement in STATEMENTS:
        connection.execute(statement)
    yield connection
    connection.close()


def test_each_row_is_chained_to_the_one_before(empty):
    for i in range(3):
        assert insert_frame(empty, frame(i))
        assert insert_outcome(empty, OutcomeRecord(f"d{i}", True))
    for table in ("frame", "outcome"):
        chain = FIRST_CHAIN
        for digest, found in empty.execute(f"SELECT digest, chain FROM {table} ORDER BY seq"):
            chain = chained(chain, digest)
            assert found == chain


def test_the_same_again_is_not_new(empty):
    assert [insert_frame(empty, frame(0)) for _ in range(2)] == [True, False]
    assert [insert_outcome(empty, OutcomeRecord("d0", True)) for _ in range(2)] == [True, False]
