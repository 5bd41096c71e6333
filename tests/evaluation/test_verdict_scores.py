"""Verdicts against outcomes: rates by hand, intervals by another bootstrap, and the verb."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from commands import refused
from graspcast.cli import main
from graspcast.errors import InputError, UnknownNameError
from graspcast.evaluation.verdict_scores import score_verdicts, verdict_table
from graspcast.forecasting.verdict import Verdict, VerdictRow

HEADER = "scene_id,im_id,obj_id,gripper,probability,verdict,reason\n"


def verdicts(scene: np.ndarray, attempt: np.ndarray, gripper: str = "hand") -> list[VerdictRow]:
    return [
        VerdictRow(int(s), i, 5, gripper, Verdict(bool(a), float(a), "why"))
        for i, (s, a) in enumerate(zip(scene, attempt, strict=True))
    ]


def outcomes(scene: np.ndarray, success: np.ndarray, estimator: str = "a") -> pl.DataFrame:
    table = verdict_table(verdicts(scene, success))
    return table.with_columns(
        estimator=pl.lit(estimator), dataset=pl.lit("d"), success=table["attempt"].cast(int)
    )


def some(seed: int, n: int = 400, scenes: int = 20) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    scene = rng.integers(scenes, size=n)
    lucky = rng.normal(size=scenes)[scene]
    success = rng.normal(size=n) + lucky > -0.3
    return scene, rng.normal(size=n) + success > 0.7, success


def test_rates_are_counts() -> None:
    scene, attempt, success = some(0)
    found = score_verdicts(verdicts(scene, attempt), outcomes(scene, success))
    assert (found.n, found.attempts, found.scenes, found.untried) == (400, attempt.sum(), 20, 0)
    assert found.always.value == pytest.approx(success.mean())
    assert found.attempt_rate.value == pytest.approx(attempt.mean())
    assert found.following is not None and found.gain is not None
    assert found.following.value == pytest.approx(success[attempt].mean())
    assert found.gain.value == pytest.approx(success[attempt].mean() - success.mean())


def test_intervals_are_those_of_rows_repeated_with_their_scenes() -> None:
    scene, attempt, success = some(1)
    found = score_verdicts(verdicts(scene, attempt), outcomes(scene, success), draws=4000)
    rng = np.random.default_rng(5)
    rows = [np.flatnonzero(scene == s) for s in np.unique(scene)]
    drawn = []
    for _ in range(4000):
        i = np.concatenate([rows[k] for k in rng.integers(len(rows), size=len(rows))])
        drawn.append((success[i].mean(), success[i][attempt[i]].mean(), attempt[i].mean()))
    always, following, rate = np.array(drawn).T
    for mine, other in (
        (found.always, always),
        (found.following, following),
        (found.attempt_rate, rate),
        (found.gain, following - always),
    ):
        assert mine is not None
        assert [mine.low, mine.high] == pytest.approx(np.percentile(other, (2.5, 97.5)), abs=0.012)


def test_order_of_rows_and_other_outcomes_do_not_matter() -> None:
    scene, attempt, success = some(2)
    mine, theirs = verdicts(scene, attempt), outcomes(scene, success)
    whole = score_verdicts(mine, theirs)
    shuffled = theirs.sample(fraction=1.0, shuffle=True, seed=1)
    more = pl.concat([shuffled, outcomes(scene, ~success, "b")])
    assert score_verdicts(mine[::-1], more, principal="a") == whole


def test_what_cannot_be_said_is_not_said() -> None:
    scene, attempt, success = some(3)
    none = score_verdicts(verdicts(scene, attempt & False), outcomes(scene, success))
    assert none.following is None and none.gain is None and none.attempts == 0
    one = score_verdicts(verdicts(scene * 0, attempt), outcomes(scene * 0, success))
    assert math.isnan(one.always.low)
    assert one.as_dict()["always"] == {"value": success.mean(), "low": None, "high": None}
    assert str(one.always) == f"{success.mean():.3f}"
    half = outcomes(scene, success).filter(pl.col("im_id") % 2 == 0)
    assert score_verdicts(verdicts(scene, attempt), half).untried == 200


def test_whose_outcomes_is_to_be_said() -> None:
    scene, attempt, success = some(4)
    mine = verdicts(scene, attempt)
    both = pl.concat([outcomes(scene, success, name) for name in "ab"])
    with pytest.raises(InputError, match="several: a, b; say which, by --principal"):
        score_verdicts(mine, both)
    with pytest.raises(UnknownNameError, match="estimator 'c'; known: a, b"):
        score_verdicts(mine, both, principal="c")
    with pytest.raises(UnknownNameError, match="gripper 'claw'"):
        score_verdicts(verdicts(scene, attempt, "claw"), both, principal="a")
    with pytest.raises(InputError, match="no outcome is about any of the verdicts"):
        score_verdicts(verdicts(scene + 99, attempt), both, principal="a")


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    said, came = tmp_path / "verdicts.csv", tmp_path / "outcomes.csv"
    lines = [
        f"{i % 4},{i},5,parallel,{i / 10},{'attempt' if i > 4 else 'abstain'},why"
        for i in range(10)
    ]
    said.write_text(HEADER + "\n".join(lines) + "\n")
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
    assert "1.000 [1.000, 1.000]" in out
    content = json.loads(figures.read_text())
    assert content["following"]["value"] == 1.0
    assert content["attempts"] == 5


def test_instances_are_numbered_in_the_order_of_the_file() -> None:
    rows = [VerdictRow(1, 2, obj, "hand", Verdict(True, 0.5, "")) for obj in (5, 6, 5, 5)]
    assert verdict_table(rows)["est_id"].to_list() == [0, 0, 1, 2]


def test_files_that_are_none(files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    said, came = files
    command = ["score", "--verdicts", str(said), "--outcomes", str(came)]
    said.write_text("a,b\n1,2\n")
    assert "no column scene_id" in refused(command, capsys)
    said.unlink()
    assert "cannot be read" in refused(command, capsys)
    said.write_text(HEADER)
    assert "no outcome is about any of the verdicts" in refused(command, capsys)
