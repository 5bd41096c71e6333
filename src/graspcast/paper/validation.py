"""How simulated outcomes compare with the published ones: every cell, and the paper's Table I."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
import polars as pl

from graspcast.estimates.image_split import PARTS
from graspcast.estimates.outcomes import TRIAL_COLUMNS
from graspcast.io.markdown import table
from graspcast.paper.dataset import ESTIMATORS, GRIPPERS, OBJECTS
from graspcast.paper.tables import paper_tables, table1
from graspcast.simulation.grasps.agreement import agreement
from graspcast.simulation.grasps.observed_trials import ObservedTrials
from graspcast.simulation.grasps.table import GraspTable

__all__ = ["compare", "render_cells", "render_table1", "summary"]

_OPEN_RATES = (0.1, 0.9)


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
        The campaign's outcomes of them.
    grasps
        The reference grasps that were tried.
    held
        (object, gripper) to how many of 20 jittered perfect estimates were held.

    Returns
    -------
        ``cells."<object> by <gripper>"`` with the agreement on each part, counts of reasons on the
        report part, and the grasp's own figures; ``table1.<object>.<estimator>.<gripper>``;
        ``summary``.
    """
    keys = trials.requests.keys.with_columns(
        given=pl.Series(trials.success), part=pl.Series(trials.part.astype(str))
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
            for part in PARTS:
                rows = mine.filter(pl.col("part") == part)
                cell[part] = asdict(agreement(rows["success"].to_numpy(), rows["given"].to_numpy()))
            report = mine.filter(pl.col("part") == "report")
            cell["reasons"] = dict(report["reason"].value_counts().sort("reason").rows())
            cell["perfect_held"] = held[name, gripper]
            cell["grasp"] = dict(grasps(name, gripper).agreement)
            cells[f"{name} by {gripper}"] = cell
    ours = table1(outcomes.with_columns(pl.col("success").cast(pl.Int64)))
    found: dict[str, Any] = {"cells": cells, "table1": ours, "trials": len(joined)}
    return found | {"summary": summary(found)}


def summary(found: Mapping[str, Any]) -> dict[str, Any]:
    """Means over cells on the report part, and the mean absolute difference from Table I."""
    cells = found["cells"]
    reports = {name: cell["report"] for name, cell in cells.items()}
    low, high = _OPEN_RATES
    kappas = [r["kappa"] for r in reports.values() if low <= r["given_rate"] <= high]
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
        "accuracy": float(np.mean([r["accuracy"] for r in reports.values()])),
        "majority": float(np.mean([r["majority"] for r in reports.values()])),
        "kappa_open_cells": float(np.mean(kappas)) if kappas else None,
        "open_cells": len(kappas),
        "below_majority": [n for n, r in reports.items() if r["accuracy"] < r["majority"]],
        "perfect_held_by_all": all(cell["perfect_held"] == 20 for cell in cells.values()),
        "table1_mean_absolute_difference": float(np.mean(differences)),
    }


def render_cells(found: Mapping[str, Any]) -> str:
    """The cells as a Markdown table."""
    header = ["Object", "gripper", "fit", "choose", "report", "± s.e.", "majority", "κ"]
    header += ["rate", "ours", "n", "blocked", "unstable", "perfect", "tried"]
    rows = []
    for pair, cell in found["cells"].items():
        name, gripper = pair.split(" by ")
        report = cell["report"]
        numbers = [cell["fit"]["accuracy"], cell["choose"]["accuracy"]]
        numbers += [report[k] for k in ("accuracy", "standard_error", "majority", "kappa")]
        numbers += [report["given_rate"], report["simulated_rate"]]
        counts = [report["n"], *(cell["reasons"].get(r, 0) for r in ("blocked", "unstable"))]
        rows.append(
            [OBJECTS[name], gripper, *(f"{x:.3f}" for x in numbers), *map(str, counts)]
            + [f"{cell['perfect_held']}/20", str(cell["grasp"].get("candidates", "-"))]
        )
    return table(header, rows)


def render_table1(found: Mapping[str, Any]) -> str:
    """Table I as Markdown: paper | ours."""
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
