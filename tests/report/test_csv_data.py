"""Data behind figures."""

from __future__ import annotations

import base64
import csv
import io

from hypothesis import given
from hypothesis import strategies as st

from graspcast.report.csv_data import csv_text, data_uri


def read(text: str) -> list[list[str]]:
    return list(csv.reader(io.StringIO(text)))


def test_text_that_a_spreadsheet_would_run_gets_an_apostrophe() -> None:
    rows = [["=1+1", "+a", "-b", "@c", "\tx", " =d", "plain", -1.5, None, True, float("nan")]]
    (_, found) = read(csv_text(list("abcdefghijk"), rows))
    assert found[:6] == ["'=1+1", "'+a", "'-b", "'@c", "'\tx", "' =d"]
    assert found[6:] == ["plain", "-1.5", "", "True", ""]


@given(st.text())
def test_no_text_begins_a_formula(text: str) -> None:
    (_, (cell, _)) = read(csv_text(["a", "b"], [[text, 1]]))
    assert not cell.lstrip(" ").startswith(("=", "+", "-", "@"))


def test_an_address_holds_the_content() -> None:
    head, _, body = data_uri("a,ü\n").partition(",")
    assert head == "data:text/csv;charset=utf-8;base64"
    assert base64.b64decode(body).decode() == "a,ü\n"
