"""Markdown tables."""

from __future__ import annotations

from graspcast.io.markdown import table


def test_columns_are_aligned() -> None:
    assert table(["name", "n"], [["a", 10], ["longer", "2"]]).splitlines() == [
        "| name   |  n |",
        "| ------ | -: |",
        "| a      | 10 |",
        "| longer |  2 |",
    ]


def test_several_columns_of_text() -> None:
    assert table(["a", "b", "c"], [["x", "yy", 1]], text_columns=2).splitlines() == [
        "| a | b  | c |",
        "| - | -- | : |",
        "| x | yy | 1 |",
    ]
