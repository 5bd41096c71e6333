"""What each estimator and each view is worth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from graspcast.bop.results import Results
from graspcast.demo_data import demo_dataset
from graspcast.report.run_data import RunData
from graspcast.report.worth import worth_section


def test_guides_and_views(run: RunData) -> None:
    guides, views = worth_section(run).tables
    assert [row[0].text for row in guides.rows] == ["a", "fused"]
    assert guides.rows[0][4].value == pytest.approx(run.trials[0].table["success"].mean())
    held = guides.columns.index("held")
    assert guides.rows[0][held].value == run.trials[0].table["success"].sum()
    assert [(row[0].value, row[1].value) for row in views.rows] == [(1, 1), (2, 2)]


def test_errors_of_estimators_where_there_is_ground_truth(run: RunData) -> None:
    dataset = demo_dataset()
    truth = dataset.ground_truth
    rows = np.flatnonzero(truth.scene_id == 1)[:20]
    off = truth.cam_T_obj[rows].copy()
    off[:, 0, 3] += 0.005
    table = Results(
        scene_id=truth.scene_id[rows],
        im_id=truth.im_id[rows],
        obj_id=truth.obj_id[rows],
        score=np.ones(len(rows)),
        cam_T_obj=off,
        time_s=np.ones(len(rows)),
        line=np.arange(len(rows)),
    )
    more = replace(run, results={"ycbv": {"mine": table}}, datasets={"ycbv": dataset})
    found = next(t for t in worth_section(more).tables if t.key == "estimators")
    (row,) = found.rows
    assert row[0].text == "mine" and row[3].value == pytest.approx(0.0, abs=1e-3)
    assert row[5].value == pytest.approx(5.0)
