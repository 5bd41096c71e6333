"""The table of all forecasts with several views, from which scores and policies are computed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float
from numpy import ndarray

from graspcast._version import __version__
from graspcast.estimates.instances import unit_names
from graspcast.evaluation.benchmark import Benchmark
from graspcast.evaluation.view_protocols import (
    FoldModels,
    ViewFold,
    forecast_fold,
    forecast_views,
    train_fold,
    view_folds,
)
from graspcast.evaluation.view_sets import ViewRow, ViewSet
from graspcast.forecasting.look_again import looks_for
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.view_verdicts import FUSED
from graspcast.io.hashing import sha256
from graspcast.io.progress import Progress, step_of
from graspcast.io.tables import read_parquet, write_table
from graspcast.views.camera_motion import CameraNoise

__all__ = ["ONE_VIEW", "forecast_with_views", "view_digest"]

ONE_VIEW = ViewRow("one view", 1)
"""The row of poses fused from one view; its forecasts are the belief before a second look."""
_SCHEMA = {
    "row": pl.String,
    "alone": pl.String,
    "principal": pl.String,
    "gripper": pl.String,
    "instance": pl.Int64,
    "views": pl.Int64,
    "entered": pl.Int64,
    "probability": pl.Float64,
    "one_view": pl.Float64,
    "success": pl.Boolean,
    "expected": pl.Float64,
}
"""Columns: the row of the table, its only estimator, whose pose guides, the number of the instance,
views that were gathered and that entered, the forecast, that from one view, the outcome if it is
published, and the expected forecast after a further look, guided by the fused pose."""


def view_digest(benchmark: Benchmark) -> str:
    """Return the SHA-256 of what forecasts with views depend on."""
    assert benchmark.views is not None
    parts: list[str | ndarray] = [benchmark.digest(own_trials=True)]
    for rule, data in benchmark.views.train.items():
        parts += [repr(rule), data.row, data.statistics]
    for row, found in benchmark.views.test.items():
        parts += [repr(row), found.data.row, found.data.statistics]
    return sha256(*parts)


def forecast_with_views(
    benchmark: Benchmark,
    protocol: str,
    rows: Sequence[ViewRow],
    *,
    settings: ForestSettings | None = None,
    work: Path | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> pl.DataFrame:
    """Compute the forecasts of all rows of the table, principals and grippers under a protocol.

    Parameters
    ----------
    benchmark
        With fused poses.
    protocol
        One of :data:`graspcast.evaluation.view_protocols.VIEW_PROTOCOLS`.
    rows
        Of the table.
    settings
        Of the forests.
    work
        Directory in which each fold's forecasts are saved, and from which they are read again, if
        data, rows, settings and version are the same.
    seed
        Of the folds, and of the forests.
    progress
        Called with the share of the work that is done and a message.

    Returns
    -------
        One row for each forecast. Beside the principals, ``fused`` guides, without outcomes.
    """
    settings = settings or ForestSettings(seed=seed)
    asked = [protocol, repr(list(rows)), repr(settings), str(seed), __version__]
    digest = sha256(view_digest(benchmark), *asked)[:16] if work is not None else ""
    grippers = sorted({g for _, g in benchmark.pairs()})
    out = []
    for g, gripper in enumerate(grippers):
        folds = list(view_folds(benchmark, protocol, gripper, seed=seed))
        for i, fold in enumerate(folds):
            message = f"{protocol.replace('_', ' ')}: {gripper}"
            step = step_of(progress, g * len(folds) + i, len(grippers) * len(folds), message)
            step(0.0, "")
            path = None if work is None else work / protocol / f"{gripper}-{i}-{digest}.parquet"
            if path is not None and path.exists():
                out.append(read_parquet(path))
                continue
            found = _of_fold(benchmark, fold, rows, settings, step)
            if path is not None:
                path.parent.mkdir(parents=True, exist_ok=True)
                write_table(path, found)
            out.append(found)
    return _with_keys(benchmark, pl.concat(out))


def _of_fold(
    benchmark: Benchmark,
    fold: ViewFold,
    rows: Sequence[ViewRow],
    settings: ForestSettings,
    progress: Progress | None,
) -> pl.DataFrame:
    models = train_fold(fold, [row.rule for row in rows], settings, progress=progress)
    parts = []
    for each in forecast_fold(fold, models, rows):
        test = fold.tests[each.principal]
        found = fold.tasks[each.principal].views
        assert found is not None
        parts.append(
            _frame(
                fold,
                each.row,
                each.principal,
                found.test[each.row.fusion],
                benchmark.rows_of(test.estimates),
                probability=each.probability,
                one_view=each.one_view,
                success=test.own_success[each.which] == 1,
            )
        )
    return pl.concat([*parts, *_guided_by_fused(benchmark, fold, models, rows)])


def _guided_by_fused(
    benchmark: Benchmark, fold: ViewFold, models: FoldModels, rows: Sequence[ViewRow]
) -> Iterator[pl.DataFrame]:
    """Yield the forecasts of grasps that the pose fused from one view and from several guides."""
    task = fold.first
    assert task.views is not None
    plain = [row for row in rows if row == ViewRow(row.name, row.views)]
    for row in [ONE_VIEW, *plain]:
        found = task.views.test[row.fusion]
        given = (models.blend, found, task.test, FUSED, task.models)
        probability = forecast_views(*given, least_views=1)
        expected = np.full(len(found), np.nan)
        for part, fused in enumerate(found.fused):
            mine = found.part == part
            if mine.any():
                looks = looks_for(
                    models.blend,
                    fused,
                    found.number[mine],
                    found.data.statistics[mine],
                    noise=CameraNoise(),
                )
                after = [look.expected_probability for look in looks]
                expected[mine] = [np.nan if p is None else p for p in after]
        numbers = benchmark.rows_of(task.test)
        yield _frame(fold, row, FUSED, found, numbers, probability=probability, expected=expected)


def _frame(
    fold: ViewFold,
    row: ViewRow,
    principal: str,
    found: ViewSet,
    numbers: ndarray,
    *,
    probability: Float[ndarray, " m"],
    one_view: Float[ndarray, " m"] | None = None,
    success: ndarray | None = None,
    expected: Float[ndarray, " m"] | None = None,
) -> pl.DataFrame:
    n = len(found)
    empty = pl.Series([None] * n)
    columns = {
        "row": [row.name] * n,
        "alone": [row.rule.alone] * n,
        "principal": [principal] * n,
        "gripper": [fold.gripper] * n,
        "instance": numbers[found.data.row],
        "views": found.gathered,
        "entered": found.data.views,
        "probability": pl.Series(probability).fill_nan(None),
        "one_view": empty if one_view is None else one_view,
        "success": empty if success is None else success,
        "expected": empty if expected is None else pl.Series(expected).fill_nan(None),
    }
    return pl.DataFrame(columns, schema=_SCHEMA, strict=False)


def _with_keys(benchmark: Benchmark, found: pl.DataFrame) -> pl.DataFrame:
    """Add each instance's object, scene (or block of frames) and image."""
    instances = benchmark.estimates.instances
    names = pl.DataFrame(
        {
            "instance": np.arange(len(benchmark)),
            "object": benchmark.estimates.objects.astype(str),
            "scene": benchmark.scenes.astype(str),
            "image": unit_names(instances, "image").astype(str),
        }
    )
    return found.join(names, on="instance", maintain_order="left")
