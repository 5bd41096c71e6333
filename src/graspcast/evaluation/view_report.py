"""The evaluation with several views: scores of all rows, policies and certificates."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import polars as pl

from graspcast.evaluation.benchmark import Benchmark
from graspcast.evaluation.bootstrap import Bootstrap
from graspcast.evaluation.held_out_certificates import certify_views
from graspcast.evaluation.net_benefit import Costs
from graspcast.evaluation.view_policy import THRESHOLD, expectation, score_policies
from graspcast.evaluation.view_protocols import VIEW_PROTOCOLS
from graspcast.evaluation.view_scores import score_views
from graspcast.evaluation.view_sets import ViewRow
from graspcast.evaluation.view_table import forecast_with_views
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.io.progress import Progress

__all__ = ["evaluate_views", "rows_of"]

_FULL = "several_views"


def rows_of(protocols: Sequence[str], rows: Sequence[ViewRow]) -> list[ViewRow]:
    """Return the rows that some protocols have: unseen objects those that one model answers."""
    if _FULL in protocols:
        return list(rows)
    return [row for row in rows if row == ViewRow(row.name, row.views)]


def evaluate_views(
    benchmark: Benchmark,
    protocols: Sequence[str],
    rows: Sequence[ViewRow],
    *,
    settings: ForestSettings | None = None,
    costs: Costs | None = None,
    bootstrap: Bootstrap | None = None,
    work: Path | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Evaluate forecasts with several views.

    Parameters
    ----------
    benchmark
        With fused poses; its simulated outcomes, if they have the estimators ``fused2`` and
        ``fused3``, are those of grasps that fused poses guided.
    protocols
        Of :data:`graspcast.evaluation.view_protocols.VIEW_PROTOCOLS`.
    rows
        Of the table. Unseen objects are forecast in the rows of all estimators and undisturbed
        motion alone, which one model answers.
    costs, bootstrap
        As for :func:`graspcast.evaluation.report.evaluate`.
    settings, work, seed, progress
        As for :func:`graspcast.evaluation.view_table.forecast_with_views`.

    Returns
    -------
        ``<protocol>`` with ``description`` and ``scores``
        (:func:`graspcast.evaluation.view_scores.score_views`); for scenes also ``policies``,
        ``threshold``, ``expectation`` (:mod:`graspcast.evaluation.view_policy`) and
        ``certificates`` (:func:`graspcast.evaluation.held_out_certificates.certify_views`).
    """
    out: dict[str, Any] = {}
    for protocol in protocols:
        wanted = rows_of([protocol], rows)
        found = forecast_with_views(
            benchmark,
            protocol,
            wanted,
            settings=settings,
            work=work,
            seed=seed,
            progress=progress,
        )
        mine: dict[str, Any] = {
            "description": VIEW_PROTOCOLS[protocol],
            "scores": score_views(found, costs=costs, bootstrap=bootstrap),
        }
        if protocol == _FULL:
            mine |= _used(found, benchmark, bootstrap, seed)
        out[protocol] = mine
    return out


def _used(
    found: pl.DataFrame, benchmark: Benchmark, bootstrap: Bootstrap | None, seed: int
) -> dict[str, Any]:
    certificates = certify_views(found, seed=seed)
    return {
        "threshold": THRESHOLD,
        "policies": score_policies(found, benchmark.simulated, bootstrap=bootstrap),
        "expectation": expectation(found),
        "certificates": [
            {k: None if v != v else v for k, v in entry.items()} for entry in certificates
        ],
    }
