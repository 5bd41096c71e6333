"""Content of a report."""

from __future__ import annotations

import base64

from graspcast.report.content import Case, Cell, Mode, Picture, Run, Section, Table


def text_of(uri: str) -> str:
    return base64.b64decode(uri.partition(",")[2]).decode()


def test_cells() -> None:
    assert Cell.of(None) == Cell.of(float("nan")) == Cell("-", None)
    assert Cell.of(1234) == Cell("1,234", 1234.0) and Cell.of(0.5, 1) == Cell("0.5", 0.5)
    assert Cell.of("a\x00") == Cell("a\ufffd") and Cell.of(True).text == "yes"


def test_the_csv_of_a_table_has_the_ends_of_intervals() -> None:
    rows = ((Cell("=x"), Cell("0.5 [0.4, 0.6]", 0.5, (0.4, 0.6))), (Cell("y"), Cell.of(None)))
    table = Table("t", "caption", ("name", "rate"), rows, (False, True))
    assert text_of(table.uri).splitlines() == [
        'name,rate,"rate, low","rate, high"',
        "'=x,0.5,0.4,0.6",
        "y,,,",
    ]
    own = Table("t", "", ("name",), ((Cell("y"),),), (False,), (("a", "b"), ((1, 2.0),)))
    assert text_of(own.uri) == "a,b\n1,2\n"


def test_fewer_pictures_leave_the_cases() -> None:
    picture = Picture("p", "alt", b"123456", 2, 3)
    case = Case("title", (("a", "b"),), (picture,))
    assert case.bytes == len(picture.uri) and picture.uri.startswith("data:image/webp;base64,")
    run = Run("r", "", (), (Section("s", "S", modes=(Mode("m", "M", "", (case, case), 5),)),))
    (mode,) = run.with_cases([("m", 1)]).sections[0].modes
    assert [len(one.pictures) for one in mode.cases] == [1, 0]
    assert Section("s", "S").is_empty and not Section("s", "S", code="x").is_empty
