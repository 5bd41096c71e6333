"""Verdicts joined with outcomes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from graspcast.errors import MismatchError
from graspcast.report.decisions import decide_on
from graspcast.report.looks import read_looks
from graspcast.report.run_data import RunData
from graspcast.report.trials import read_trials
from small_run import IMAGES, SCENES, THRESHOLD, outcomes, verdicts, write_run


def test_each_look_has_its_outcomes_and_looking_ends_once(run: RunData) -> None:
    found = run.decisions
    assert found is not None and found.most_looks == 2 and found.threshold == THRESHOLD
    assert len(found.table) == 2 * SCENES * IMAGES == 2 * len(found.last)
    assert found.table["success"].null_count() == 0
    assert found.table["row"].to_list() == list(range(len(found.table)))
    for look in (1, 2):
        rows = verdicts(look)
        expected = {r.key: s for r, s in zip(rows, outcomes(rows)["success"], strict=True)}
        for row in found.at(look).iter_rows(named=True):
            key = tuple(row[n] for n in ("dataset", "scene_id", "im_id", "obj_id", "est_id"))
            assert row["success"] == expected[key]  # type: ignore[index]
    assert set(found.table["outcome"]) >= {"held", "dropped"}
    first = found.at(1).row(0, named=True)
    shift = np.linalg.norm([first[f"error_{axis}_m"] for axis in "xyz"])
    assert first["error_m"] == pytest.approx(shift)
    assert found.table["unusual"].sum() == 2
    assert set(found.trials_of.tolist()) == {0, 1}


def test_verdicts_without_outcomes(tmp_path: Path) -> None:
    directory = write_run(tmp_path / "run")
    found = decide_on(read_looks([directory / "verdicts1.csv"], []), [], {})
    assert found.table["success"].null_count() == len(found.table)
    assert found.outcomes == ((None,),) and set(found.trials_of.tolist()) == {-1}


def test_outcomes_that_do_not_say_of_which_instance(tmp_path: Path) -> None:
    from dataclasses import replace

    from graspcast.forecasting.verdict_file import write_verdicts

    rows = verdicts(1)[:2]
    rows.append(replace(rows[0], key=rows[0].key._replace(est_id=1)))
    write_verdicts(tmp_path / "v.csv", rows)
    table = outcomes(rows[:1], details=False).drop("est_id")
    table.write_csv(tmp_path / "o.csv")
    looks, trials = read_looks([tmp_path / "v.csv"], []), read_trials(tmp_path / "o.csv")
    with pytest.raises(MismatchError, match="which one was tried is not known"):
        decide_on(looks, [trials], {})
    # Where there is one instance only, it is clear.
    write_verdicts(tmp_path / "v.csv", rows[:2])
    found = decide_on(read_looks([tmp_path / "v.csv"], []), [trials], {})
    assert found.table["success"].is_not_null().sum() == 1
    assert found.table.filter(pl.col("success").is_not_null())["im_id"].to_list() == [0]
