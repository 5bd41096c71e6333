"""Validation of the simulation: simulated against published outcomes, and the paper's Table I."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from os import PathLike
from typing import Any

import numpy as np
import polars as pl

from graspcast.bop.results import read_results
from graspcast.estimates.image_split import SPLITS
from graspcast.estimates.outcomes import TRIAL_COLUMNS
from graspcast.io.markdown import table
from graspcast.paper.dataset import DATASETS, ESTIMATORS, GRIPPERS, OBJECTS, Published
from graspcast.paper.tables import paper_tables, table1
from graspcast.simulation.campaign.campaign import run_campaign
from graspcast.simulation.campaign.executors import Executor
from graspcast.simulation.campaign.jobs import load_setups
from graspcast.simulation.grasps.agreement import agreement
from graspcast.simulation.grasps.evaluation import held_under_jitter
from graspcast.simulation.grasps.observed_trials import ObservedTrials, observed_trials
from graspcast.simulation.grasps.table import GraspTable
from graspcast.simulation.trial.settings import TrialSettings

__all__ = ["compare", "published_trials", "render_cells", "render_table1", "summary", "validate"]

_OPEN_RATES = (0.1, 0.9)


def published_trials(data: Published) -> ObservedTrials:
    """Return the published trials: estimates, ground truth and outcomes."""
    # The paper's tables count placeholders for 'nothing found' as estimates.
    results = {
        name: {e: read_results(data.results_path(e, name), placeholders=True) for e in ESTIMATORS}
        for name in DATASETS
    }
    return observed_trials(results, data.bop, data.outcomes)


def validate(
    data: Published,
    grasps: GraspTable,
    out: str | PathLike[str],
    *,
    executor: Executor | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> dict[str, Any]:
    """Simulate every published trial by the paper's protocol, and compare the outcomes.

    See :func:`compare`.

    Parameters
    ----------
    data
        The published data.
    grasps
        Reference grasps.
    out
        Directory of the campaign, which can be resumed.
    executor
        Where to compute; all cores of this machine if None.
    progress
        Called with the share done and a short message.
    """
    trials = published_trials(data)
    bop_dirs = {name: dataset.root for name, dataset in data.bop.items()}
    setups = load_setups(trials.requests, grasps, settings=TrialSettings.paper(), bop_dirs=bop_dirs)
    outcomes = run_campaign(trials.requests, setups, out, executor=executor, progress=progress)
    held = {}
    for i, (key, setup) in enumerate(setups.items()):
        if progress is not None:
            progress(i / len(setups), "perfect estimates of {} by {}".format(*key))
        held[key[:2]] = held_under_jitter(setup.runner(), setup.grasp)
    return compare(trials, outcomes, grasps, held)


def compare(
    trials: ObservedTrials,
    outcomes: pl.DataFrame,
    grasps: GraspTable,
    held: Mapping[tuple[str, str], int],
) -> dict[str, Any]:
    """Compare a campaign over the published trials with the published outcomes.

    Parameters
    ----------
    trials
        The published trials.
    outcomes
        Outcomes of the campaign.
    grasps
        The reference grasps of the campaign.
    held
        Number of held estimates among 20 jittered perfect ones, by (object, gripper).

    Returns
    -------
        ``cells."<object> by <gripper>"`` with the agreement on each split, counts of reasons on the
        test split, and the grasp's own figures; ``table1.<object>.<estimator>.<gripper>``;
        ``trials``; ``summary``.
    """
    keys = trials.requests.keys.with_columns(
        given=pl.Series(trials.success), split=pl.Series(trials.split.astype(str))
    )
    joined = keys.join(
        outcomes.select(*TRIAL_COLUMNS, "success", "reason"), on=list(TRIAL_COLUMNS), how="inner"
    )
    cells = {}
    for name in OBJECTS:
        for gripper in GRIPPERS:
            mine = joined.filter(pl.col("object") == name, pl.col("gripper") == gripper)
            if not len(mine):
                continue
            cell: dict[str, Any] = {}
            for split in SPLITS:
                rows = mine.filter(pl.col("split") == split)
                cell[split] = asdict(
                    agreement(rows["success"].to_numpy(), rows["given"].to_numpy())
                )
            test = mine.filter(pl.col("split") == "test")
            cell["reasons"] = dict(test["reason"].value_counts().sort("reason").rows())
            cell["perfect_held"] = held[name, gripper]
            cell["grasp"] = dict(grasps(name, gripper).agreement)
            cells[f"{name} by {gripper}"] = cell
    ours = table1(outcomes.with_columns(pl.col("success").cast(pl.Int64)))
    found: dict[str, Any] = {"cells": cells, "table1": ours, "trials": len(joined)}
    return found | {"summary": summary(found)}


def summary(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return means over cells on the test split, and the mean absolute difference from Table I."""
    cells = found["cells"]
    tests = {name: cell["test"] for name, cell in cells.items()}
    low, high = _OPEN_RATES
    kappas = [r["kappa"] for r in tests.values() if low <= r["given_rate"] <= high]
    paper = paper_tables()["table1"]
    differences = [
        abs(found["table1"][name][e][g] - paper[name][e][g])
        for name in OBJECTS
        for e in ESTIMATORS
        for g in GRIPPERS
        if paper[name][e][g] is not None and found["table1"][name][e][g] is not None
    ]
    return {
        "cells": len(cells),
        "accuracy": float(np.mean([r["accuracy"] for r in tests.values()])),
        "majority": float(np.mean([r["majority"] for r in tests.values()])),
        "kappa_open_cells": float(np.mean(kappas)) if kappas else None,
        "open_cells": len(kappas),
        "below_majority": [n for n, r in tests.items() if r["accuracy"] < r["majority"]],
        "perfect_held_by_all": all(cell["perfect_held"] == 20 for cell in cells.values()),
        "table1_mean_absolute_difference": float(np.mean(differences)),
    }


def render_cells(found: Mapping[str, Any]) -> str:
    """Render the cells as a Markdown table."""
    header = ["Object", "gripper", "train", "validation", "test", "± s.e.", "majority", "κ"]
    header += ["rate", "ours", "n", "blocked", "unstable", "perfect", "tried"]
    rows = []
    for pair, cell in found["cells"].items():
        name, gripper = pair.split(" by ")
        test = cell["test"]
        numbers = [cell["train"]["accuracy"], cell["validation"]["accuracy"]]
        numbers += [test[k] for k in ("accuracy", "standard_error", "majority", "kappa")]
        numbers += [test["given_rate"], test["simulated_rate"]]
        counts = [test["n"], *(cell["reasons"].get(r, 0) for r in ("blocked", "unstable"))]
        rows.append(
            [OBJECTS[name], gripper, *(f"{x:.3f}" for x in numbers), *map(str, counts)]
            + [f"{cell['perfect_held']}/20", str(cell["grasp"].get("candidates", "-"))]
        )
    return table(header, rows)


def render_table1(found: Mapping[str, Any]) -> str:
    """Render Table I as Markdown, the paper's rates beside ours."""
    paper, ours = paper_tables()["table1"], found["table1"]
    header = ["Object"]
    header += [
        f"{e} {g[:3]}. {who}" for e in ESTIMATORS for g in GRIPPERS for who in ("paper", "ours")
    ]
    rows = []
    for name, title in OBJECTS.items():
        row = [title]
        for e in ESTIMATORS:
            for g in GRIPPERS:
                pair = (paper[name][e][g], ours[name][e][g])
                row += ["-" if value is None else f"{value:.3f}" for value in pair]
        rows.append(row)
    return table(header, rows)
