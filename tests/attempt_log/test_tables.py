import sqlite3

from attempt_records import frame
from graspcast.attempt_log.schema import STATEMENTS
from graspcast.attempt_log.tables import (
    Wanted,
    decisions_table,
    estimates_table,
    frames_table,
    outcomes_table,
    whole_table,
)
from graspcast.attempt_log.writing import insert_frame


def test_an_empty_log_has_empty_tables_of_the_same_columns():
    connection = sqlite3.connect(":memory:")
    for statement in STATEMENTS:
        connection.execute(statement)
    tables = (decisions_table, estimates_table, frames_table, outcomes_table)
    before = [table(connection) for table in tables]
    insert_frame(connection, frame(0))
    for table, empty in zip(tables, before, strict=True):
        assert len(empty) == 0
        assert empty.schema == table(connection).schema
    assert whole_table(connection, Wanted())["success"].to_list() == [None]
    connection.close()
