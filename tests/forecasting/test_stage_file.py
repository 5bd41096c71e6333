"""The file of verdicts after each look: read as it was written, and checked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from graspcast.errors import FormatError
from graspcast.estimates.instances import InstanceKey
from graspcast.forecasting.stage_file import STAGE_COLUMNS, read_stages, write_stages
from graspcast.forecasting.verdict import InstanceLooks, Verdict, VerdictRow
from graspcast.forecasting.verdict_file import read_verdicts
from graspcast.views.next_look import NextLook

AHEAD = np.array([0.0, 0.0, 1.0])
AGAIN = NextLook(AHEAD, AHEAD, AHEAD, 0.01, 1.0, 0.75)


def row(said: str, guide: str, image: int, est_id: int = 0) -> VerdictRow:
    look = AGAIN if said == "l" else None
    verdict = Verdict(said == "a", 0.5, "why", look=look)
    return VerdictRow(InstanceKey("d", 1, image, 5, est_id), guide, "hand", verdict, np.eye(4))


LOOKS = [
    InstanceLooks((row("l", "a", 0), row("a", "fused2", 0), row("a", "fused3", 0, 1)), 2),
    InstanceLooks((row("l", "a", 1),), 1),
    InstanceLooks((row("n", "a", 2), row("l", "a", 2)), 1),
]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write_stages(tmp_path / "stages.csv", LOOKS)
    return tmp_path / "stages.csv"


def test_it_is_read_as_it_was_written(path: Path) -> None:
    assert path.read_text().splitlines()[0] == ",".join(STAGE_COLUMNS)
    found = read_stages(path)
    assert [each.ended for each in found] == [2, 1, 1]
    for mine, given in zip(found, LOOKS, strict=True):
        assert [r.principal for r in mine.rows] == [r.principal for r in given.rows]
        assert [r.key for r in mine.rows] == [r.key for r in given.rows]
        assert [str(r.verdict) for r in mine.rows] == [str(r.verdict) for r in given.rows]
    assert found[0].last.principal == "fused2"
    assert "3 looks, ended after 2" in repr(found[0])
    write_stages(path, [])
    assert read_stages(path) == []


@pytest.mark.parametrize(
    ("line", "column", "value", "message"),
    [
        (2, "looks", "1", "line 2 is of the same instance and look"),
        (2, "looks", "4", "instance 0 has looks 1, 3, 4, not all from 1 to 4"),
        (2, "looks", "one", "line 3: looks is 'one', not a whole number"),
        (2, "ended", "maybe", "line 3: ended is 'maybe', not yes or no"),
        (2, "ended", "no", "looking ends after look 2, but ended is yes after none"),
        (1, "ended", "yes", "looking ends after look 2, but ended is yes after 1, 2"),
        (2, "im_id", "7", "line 3: instance 0 is another object, image or gripper than in"),
        (2, "instance", "-1", "line 3: instance is '-1', not a whole number"),
        (2, "verdict", "perhaps", "line 3: the verdict is 'perhaps'"),
    ],
)
def test_what_does_not_fit_is_named(
    path: Path, line: int, column: str, value: str, message: str
) -> None:
    lines = path.read_text().splitlines()
    fields = lines[line].split(",")
    fields[STAGE_COLUMNS.index(column)] = value
    lines[line] = ",".join(fields)
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(FormatError, match=message):
        read_stages(path)


def test_it_and_a_file_of_verdicts_are_told_apart(path: Path) -> None:
    with pytest.raises(FormatError, match="holds the verdicts after each look") as caught:
        read_verdicts(path)
    assert "stages" in caught.value.parameters
    text = path.read_text().splitlines()
    path.write_text("\n".join(",".join(line.split(",")[:-3]) for line in text) + "\n")
    with pytest.raises(FormatError, match="no column instance, looks, ended; a file of verdicts"):
        read_stages(path)
