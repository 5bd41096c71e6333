"""The demonstration's table and choice of pictures, on verdicts and outcomes that are made up."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from graspcast.cli.demo_looks import LOOKS, DemoFiles, print_looks, some_images, told_instance
from graspcast.estimates.instances import InstanceKey
from graspcast.evaluation.verdict_scores import verdict_table
from graspcast.forecasting.verdict import Verdict, VerdictRow
from graspcast.forecasting.verdict_file import write_verdicts

POSE = np.eye(4)
POSE[2, 3] = 1.0


def written(out: Path, one: list[tuple[float, int]], every: list[tuple[float, int]]) -> DemoFiles:
    """Probabilities and outcomes of two objects an image, after one look and after more."""
    files = DemoFiles(out, "d")
    for looks in range(1, LOOKS + 1):
        of, guide = (one, "dense") if looks == 1 else (every, "fused")
        rows = [
            VerdictRow(
                InstanceKey("d", i // 2, 0, i % 2 + 1, 0),
                guide,
                "parallel",
                Verdict(p >= 0.8, p, "why", threshold=0.8),
                POSE,
                views=looks,
            )
            for i, (p, _) in enumerate(of)
        ]
        write_verdicts(files.verdicts(looks), rows)
        outcomes = verdict_table(rows).with_columns(success=pl.Series([s for _, s in of]))
        files.trials(looks).parent.mkdir(exist_ok=True)
        outcomes.drop("attempt", "probability").write_csv(files.trials(looks).with_suffix(".csv"))
    return files


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> DemoFiles:
    trials = DemoFiles.trials
    made = written(
        tmp_path,
        [(0.3, 0), (0.7, 0), (0.9, 1), (0.75, 1), (0.5, 0), (0.6, 0)],
        [(0.9, 1), (0.95, 1), (0.9, 1), (0.9, 1), (0.99, 0), (0.7, 1)],
    )
    monkeypatch.setattr(
        DemoFiles, "trials", lambda self, looks: trials(self, looks).with_suffix(".csv")
    )
    return made


def test_the_story_is_of_a_likely_grasp_that_fails_and_holds_after_more_looks(
    files: DemoFiles,
) -> None:
    row = told_instance(files)
    assert row is not None
    # 0.75 held anyway, 0.6 is not attempted later.
    assert (row["scene_id"], row["obj_id"], row["probability"]) == (0, 2, 0.7)
    assert row["est_id"] == row["fused_est_id"] == 0


def test_images_with_both_verdicts_come_first(files: DemoFiles) -> None:
    assert some_images(files) == ["1/0"]


def test_the_table(files: DemoFiles, capsys: pytest.CaptureFixture[str]) -> None:
    print_looks(files, "dense")
    said = capsys.readouterr().out
    assert "6 grasps in 3 scenes" in said and "guided by dense" in said
    lines = {line.split("│")[1].strip(): line for line in said.splitlines() if "│" in line}
    assert "0.333" in lines["one look, always attempting"]
    assert "1.000" in lines["one look, verdicts"] and "0.167" in lines["one look, verdicts"]
    assert "0.833" in lines["always three looks, always attempting"]


def test_without_such_a_grasp_there_is_no_story(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trials = DemoFiles.trials
    made = written(tmp_path, [(0.9, 1), (0.3, 0)], [(0.9, 1), (0.3, 0)])
    monkeypatch.setattr(
        DemoFiles, "trials", lambda self, looks: trials(self, looks).with_suffix(".csv")
    )
    assert told_instance(made) is None
