from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest

from campaign_script import make_requests
from graspcast.paper.tables import paper_tables
from graspcast.paper.validation import compare, render_cells, render_table1, validate
from graspcast.simulation.campaign.jobs import TrialSetup
from graspcast.simulation.campaign.requests import TrialRequests
from graspcast.simulation.grasps.observed_trials import ObservedTrials
from graspcast.simulation.grasps.table import GraspTable, ReferenceGrasp, read_grasps
from graspcast.simulation.objects.types import Grasp

HANDS = ("parallel", "underactuated")


@pytest.fixture(scope="module")
def found() -> dict[str, Any]:
    """Six trials a gripper of the soup can by one estimator, two in each split."""
    keys = pl.DataFrame(
        {
            "estimator": ["epos"] * 12,
            "dataset": ["ycbv"] * 12,
            "scene_id": [50] * 12,
            "im_id": 2 * list(range(6)),
            "obj_id": [4] * 12,
            "est_id": [0] * 12,
            "gripper": np.repeat(HANDS, 6).tolist(),
        }
    )
    given = np.array([1, 0, 1, 0, 1, 0, 1, 1, 1, 1, 1, 1], dtype=bool)
    ours = np.array([1, 1, 1, 0, 1, 0, 1, 1, 1, 1, 1, 0], dtype=bool)
    reasons = ["held" if s else "blocked" for s in ours]
    split = np.array(2 * ["train", "train", "validation", "validation", "test", "test"])
    trials = ObservedTrials(TrialRequests(keys, np.tile(np.eye(4), (12, 1, 1))), given, split)
    # A campaign's outcomes come in an order of their own.
    outcomes = keys.with_columns(
        grasp=pl.lit("reference"), success=pl.Series(ours), reason=pl.Series(reasons)
    ).reverse()
    grasps = GraspTable(
        ReferenceGrasp(Grasp(np.eye(4), "ycbv-4", g), "a test", agreement={"candidates": 7})
        for g in HANDS
    )
    return compare(trials, outcomes, grasps, {("ycbv-4", g): 19 for g in HANDS})


def test_agreement_is_computed_for_each_split(found: dict[str, Any]) -> None:
    parallel = found["cells"]["ycbv-4 by parallel"]
    assert [parallel[p]["accuracy"] for p in ("train", "validation", "test")] == [0.5, 1.0, 1.0]
    assert parallel["test"]["n"] == 2 and parallel["test"]["majority"] == 0.5
    assert parallel["reasons"] == {"blocked": 1, "held": 1}, "of the test split only"


def test_summary(found: dict[str, Any]) -> None:
    summary = found["summary"]
    assert summary["accuracy"] == pytest.approx((1.0 + 0.5) / 2)
    assert (summary["open_cells"], summary["kappa_open_cells"]) == (1, pytest.approx(1.0))
    assert summary["below_majority"] == ["ycbv-4 by underactuated"]
    assert not summary["perfect_held_by_all"]
    paper = paper_tables()["table1"]["ycbv-4"]["epos"]
    difference = (abs(4 / 6 - paper["parallel"]) + abs(5 / 6 - paper["underactuated"])) / 2
    assert summary["table1_mean_absolute_difference"] == pytest.approx(difference)


def test_tables(found: dict[str, Any]) -> None:
    cells = render_cells(found).splitlines()
    assert len(cells) == 4 and "19/20" in cells[2] and cells[2].rstrip(" |").endswith("7")
    assert "0.667" in next(row for row in render_table1(found).splitlines() if "Soup can" in row)


@pytest.mark.ill_typed
def test_published_trials_are_simulated_by_the_paper_s_protocol(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    protocols: list[str] = []

    def run(requests: object, setups: dict[object, TrialSetup], *_: object, **__: object) -> None:
        protocols.extend(setup.settings.protocol for setup in setups.values())

    requests = make_requests(2)
    trials = SimpleNamespace(requests=requests)
    for name, stand_in in (
        ("published_trials", lambda _: trials),
        ("run_campaign", run),
        ("held_under_jitter", lambda runner, _: protocols.append(runner.settings.protocol)),
        ("compare", lambda *_: {}),
    ):
        monkeypatch.setattr(f"graspcast.paper.validation.{name}", stand_in)
    validate(SimpleNamespace(bop={}), read_grasps(), tmp_path)  # type: ignore[arg-type]
    assert protocols == ["paper", "paper"]
