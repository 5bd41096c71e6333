"""Output of the command line: which stream it goes to, and that nothing is lost of it."""

from __future__ import annotations

import logging

import pytest

from graspcast.cli.console import logged_as_notes, note, print_table, print_text


def test_notes_go_to_standard_error_once_each(capsys: pytest.CaptureFixture[str]) -> None:
    long = "pip install 'graspcast[render]' " + 40 * "word "
    note(long, "another", long)
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == [long, "another"]


def test_logged_warnings_are_notes_once_each(capsys: pytest.CaptureFixture[str]) -> None:
    log = logging.getLogger("graspcast.somewhere")
    with logged_as_notes():
        for _ in range(2):
            log.warning("%s is grey", "it")
        log.info("unimportant")
    assert capsys.readouterr().err.splitlines() == ["it is grey"]


def test_tables_are_not_folded_in_files(capsys: pytest.CaptureFixture[str]) -> None:
    cell = "0.512 [0.441, 0.583] " + 20 * "wide "
    print_table("Scores", ["measure", "value"], [["accuracy", cell], ["n", "60"]])
    print_text("done")
    out, err = capsys.readouterr()
    assert err == ""
    lines = out.splitlines()
    assert lines[0] == "Scores" and lines[-1] == "done"
    (row,) = (line for line in lines if "accuracy" in line)
    assert cell.strip() in row
    (last,) = (line for line in lines if "60" in line)
    assert last.rstrip("│ ").endswith(" 60"), "numbers are aligned to the right"
