"""The verb score."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from commands import refused
from graspcast.cli import main
from graspcast.estimates.instances import InstanceKey
from graspcast.forecasting.verdict import Verdict, VerdictRow
from graspcast.forecasting.verdict_file import write_verdicts


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    said, came = tmp_path / "verdicts.csv", tmp_path / "outcomes.csv"
    write_verdicts(
        said,
        [
            VerdictRow(
                InstanceKey("d", i % 4, i, 5, 0),
                "a",
                "parallel",
                Verdict(i > 4, i / 10, "why"),
                np.eye(4),
            )
            for i in range(10)
        ],
    )
    rows = [f"a,d,{i % 4},{i},5,parallel,{int(i > 3)}" for i in range(10)]
    header = "estimator,dataset,scene_id,im_id,obj_id,gripper,success\n"
    came.write_text(header + "\n".join(rows) + "\n")
    return said, came


def test_the_verb(files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    said, came = files
    figures = said.with_name("figures.json")
    command = ["score", "--verdicts", str(said), "--outcomes", str(came), "--json", str(figures)]
    assert main(command) == 0
    out = capsys.readouterr().out
    assert "always attempting" in out and "0.600" in out
    assert "following the verdicts" in out and "1.000" in out
    assert "1.000 [1.000, 1.000]" not in out  # of five attempts in three scenes or four
    low = json.loads(figures.read_text())["following"]["low"]
    assert 0.3 < low < 0.4 and f"1.000 [{low:.3f}, 1.000]" in out
    content = json.loads(figures.read_text())
    assert content["following"]["value"] == 1.0
    assert content["attempts"] == 5
    assert "10 grasps in 4 scenes, views as they were" in out
    rows = content["thresholds"]["rows"]
    assert {row["threshold"] for row in rows} >= {0.0, 0.6}
    assert rows[-1]["success"]["value"] == 0.6


def test_files_that_are_none(files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    said, came = files
    command = ["score", "--verdicts", str(said), "--outcomes", str(came)]
    said.write_text("a,b\n1,2\n")
    assert "no column dataset" in refused(command, capsys)
    said.unlink()
    assert "cannot be read" in refused(command, capsys)
    write_verdicts(said, [])
    assert "there are no verdicts to score" in refused(command, capsys)


def test_verdicts_without_an_outcome_and_without_an_attempt_are_said(
    files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    said, came = files
    rows = [
        VerdictRow(
            InstanceKey("d", i % 4, i, 5, 0),
            "a",
            "parallel",
            Verdict(False, i / 20, "why"),
            np.eye(4),
        )
        for i in range(12)
    ]
    write_verdicts(said, rows)
    assert main(["score", "--verdicts", str(said), "--outcomes", str(came)]) == 0
    out, err = capsys.readouterr()
    assert "left out 2 verdicts without an outcome" in err
    assert "nothing is attempted, so there is no success rate when following the verdicts" in err
    assert "always attempting" in out
