"""Verdicts after each look, put into order."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from graspcast.errors import MismatchError
from graspcast.forecasting.stage_file import write_stages
from graspcast.forecasting.verdict import InstanceLooks
from graspcast.forecasting.verdict_file import write_verdicts
from graspcast.report.looks import read_looks
from small_run import verdicts


def written(folder: Path, name: str, rows: list) -> Path:  # type: ignore[type-arg]
    write_verdicts(folder / name, rows)
    return folder / name


def test_files_on_the_same_instances_are_looks_in_the_order_of_their_views(tmp_path: Path) -> None:
    two = written(tmp_path, "a.csv", verdicts(2))
    one = written(tmp_path, "b.csv", verdicts(1)[::-1])
    (found,) = read_looks([two, one], [])
    assert found.paths == (one, two)
    assert len(found.stages) == 2
    assert [r.key[:4] for r in found.stages[0]] == [r.key[:4] for r in found.stages[1]]
    asked = [row.verdict.look is not None for row in found.stages[0]]
    assert found.ended.tolist() == [int(again) for again in asked] and any(asked)
    assert set(found.taken[1].tolist()) == {2}


def test_verdicts_after_each_look_say_the_same(tmp_path: Path) -> None:
    pairs = zip(verdicts(1), verdicts(2), strict=True)
    looks = [InstanceLooks((a, b), 2 if a.verdict.look else 1) for a, b in pairs]
    looks[3] = InstanceLooks((replace(looks[3].rows[1], views=1),), 1)
    write_stages(tmp_path / "stages.csv", looks)
    (found,) = read_looks([], [tmp_path / "stages.csv"])
    assert len(found.stages) == 2 and len(found.stages[0]) == len(looks)
    assert found.taken[:, 3].tolist() == [1, 1] and found.taken[1, 0] == 2


def test_files_that_do_not_go_together(tmp_path: Path) -> None:
    rows = verdicts(1)
    one, copy = written(tmp_path, "one.csv", rows), written(tmp_path, "copy.csv", rows)
    with pytest.raises(MismatchError, match="both are verdicts on the same instances from up to 1"):
        read_looks([one, copy], [])
    part = written(tmp_path, "part.csv", rows[:5])
    with pytest.raises(MismatchError, match="both have a verdict on d-1 in image 1/0"):
        read_looks([one, part], [])
    twice = [*rows, replace(rows[0], key=rows[0].key._replace(est_id=1), views=2)]
    more = written(tmp_path, "more.csv", twice)
    with pytest.raises(MismatchError, match="different numbers of verdicts"):
        read_looks([one, more], [])


def test_files_on_other_instances_stand_beside_each_other(tmp_path: Path) -> None:
    one = written(tmp_path, "one.csv", verdicts(1))
    other = written(tmp_path, "other.csv", verdicts(1, dataset="e"))
    empty = written(tmp_path, "empty.csv", [])
    assert [looks.paths for looks in read_looks([one, other, empty], [])] == [(one,), (other,)]
