"""A dataset's files are read; refusals become findings."""

from __future__ import annotations

from pathlib import Path

from sick_files import case_of, healthy


def test_whole_files_are_read(tmp_path: Path) -> None:
    case = case_of(healthy().write(tmp_path))
    assert case.name == "toy"
    assert case.findings == []
    assert list(case.results) == ["a", "b"]
    assert case.models is not None
    assert len(case.truths) == 1


def test_a_refused_part_leaves_the_others(tmp_path: Path) -> None:
    files = healthy()
    for entry in files.info.values():
        entry |= {key: value / 1000 for key, value in entry.items()}
    case = case_of(files.write(tmp_path))
    assert [f.code for f in case.findings] == ["models-unit"]
    assert case.models is None
    assert list(case.results) == ["a", "b"]


def test_rows_that_can_be_read_are_kept(tmp_path: Path) -> None:
    files = healthy()
    files.estimates["a"][1][3, 2, 3] *= -1
    case = case_of(files.write(tmp_path))
    assert len(case.results["a"]) == 47
    assert case.doubts["a"].code == "poses-behind"
