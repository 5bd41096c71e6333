"""Scores of forecasts with several views, beside those from one view on the same instances."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from graspcast.evaluation.bootstrap import Bootstrap
from graspcast.evaluation.net_benefit import Costs
from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.report import evaluate_protocol

__all__ = ["SINGLE", "VIEWS", "score_views"]

SINGLE, VIEWS = "one view", "views"
"""Names of the two methods that each row compares."""


def score_views(
    found: pl.DataFrame, *, costs: Costs | None = None, bootstrap: Bootstrap | None = None
) -> dict[str, Any]:
    """Score every row of the table, averaged over principals, with paired differences.

    Parameters
    ----------
    found
        As :func:`graspcast.evaluation.view_table.forecast_with_views` returns it.
    costs
        Of failures and of abstaining.
    bootstrap
        Settings of the intervals.

    Returns
    -------
        ``<row>.<gripper>``: ``views`` and ``one view`` with scores as
        :func:`graspcast.evaluation.report.evaluate` returns them (the first with differences from
        the second), and ``n``, the mean number of instances of a principal.
    """
    costs, bootstrap = costs or Costs(), bootstrap or Bootstrap()
    with_outcome = found.filter(pl.col("success").is_not_null())
    out: dict[str, Any] = {}
    for (row,), mine in with_outcome.group_by("row", maintain_order=True):
        forecasts = [
            _forecasts(part, str(row), method, str(principal), str(gripper))
            for (principal, gripper), part in mine.group_by(
                "principal", "gripper", maintain_order=True
            )
            for method in (VIEWS, SINGLE)
        ]
        scores, _ = evaluate_protocol(forecasts, costs, bootstrap, baselines=[SINGLE])
        out[str(row)] = {
            gripper: {
                **{method: scores[method][gripper] for method in (VIEWS, SINGLE)},
                "n": float(np.mean([len(f) for f in forecasts[::2] if f.gripper == gripper])),
            }
            for gripper in scores[VIEWS]
        }
    return out


def _forecasts(
    part: pl.DataFrame, row: str, method: str, principal: str, gripper: str
) -> Forecasts:
    return Forecasts(
        protocol=row,
        method=method,
        principal=principal,
        gripper=gripper,
        probability=part["probability" if method == VIEWS else "one_view"].to_numpy(),
        success=part["success"].to_numpy().astype(bool),
        objects=part["object"].to_numpy().astype(str),
        scenes=part["scene"].to_numpy().astype(str),
    )
