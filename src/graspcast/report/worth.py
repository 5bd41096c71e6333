"""What each estimator and each view is worth: success of the grasps they guide, and errors."""

from __future__ import annotations

from collections.abc import Mapping

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results
from graspcast.errors import GraspcastError
from graspcast.estimates.error_tables import measure
from graspcast.io.progress import Progress, step_of
from graspcast.report.content import Cell, Section, Table
from graspcast.report.decisions import Decisions
from graspcast.report.error_sizes import all_trials
from graspcast.report.rates import interval_cell, rate_of
from graspcast.report.run_data import RunData

__all__ = ["worth_section"]

_REASONS = ("held", "dropped", "slipped", "missed", "collided", "blocked", "unstable")


def worth_section(run: RunData, progress: Progress | None = None) -> Section:
    """Return the section of estimators and views; empty where nothing is known of them."""
    tables = [
        _guides(run),
        _errors(run.results, run.datasets, progress),
        None if run.decisions is None else _views(run.decisions),
    ]
    return Section(
        key="estimators-and-views",
        title="What each estimator and each view is worth",
        tables=tuple(table for table in tables if table is not None),
    )


def _guides(run: RunData) -> Table | None:
    """Return how often the grasps that each estimator guides succeed, attempted or not."""
    if not run.trials:
        return None
    table = all_trials(run.trials)
    shown = [name for name in _REASONS if name in set(table["outcome"].drop_nulls())]
    rows = []
    for path, guide in ((one.path, name) for one in run.trials for name in one.estimators):
        mine = table.filter(campaign=str(path), estimator=guide)
        scores = rate_of(mine)
        counts = dict(mine["outcome"].drop_nulls().value_counts().iter_rows())
        rows.append(
            (
                Cell.of(guide),
                Cell.of(run.files.shown(path)),
                Cell.of(len(mine)),
                Cell.of(mine["scene"].n_unique()),
                interval_cell(None if scores is None else scores.always),
                *(Cell.of(counts.get(reason, 0)) for reason in shown),
            )
        )
    return Table(
        key="guides",
        caption="Trials by who guides: success rate if every grasp is attempted, and how trials "
        "end. Compare rows of the same scenes only.",
        columns=("guide", "trials from", "trials", "scenes", "success rate", *shown),
        rows=tuple(rows),
        numeric=(False, False, *(True for _ in range(3 + len(shown)))),
    )


def _errors(
    results: Mapping[str, Mapping[str, Results]],
    datasets: Mapping[str, BopDataset],
    progress: Progress | None,
) -> Table | None:
    """Return the errors of each estimator's poses, where there is ground truth."""
    pairs = [
        (of, name, table)
        for of, tables in results.items()
        for name, table in tables.items()
        if of in datasets and datasets[of].has_ground_truth and len(table)
    ]
    rows = []
    for step, (of, name, table) in enumerate(pairs):
        report = step_of(progress, step, len(pairs), f"errors of {name} on {of}")
        report(0.0, "")
        try:
            found = measure(
                table, datasets[of], only=("rotation_deg", "translation_mm", "ray_share")
            )
        except GraspcastError:
            continue  # of images without ground truth, as those of a test split may be
        turn, shift = found["rotation_deg"], found["translation_mm"]
        numbers = [
            *(turn.quantile(q, "linear") for q in (0.5, 0.95)),
            *(shift.quantile(q, "linear") for q in (0.5, 0.95)),
        ]
        rows.append(
            (
                *(Cell.of(name), Cell.of(of), Cell.of(len(found))),
                *(Cell.of(number, 1) for number in numbers),
                Cell.of(found["ray_share"].fill_nan(None).median(), 2),
            )
        )
    if not rows:
        return None
    return Table(
        key="estimators",
        caption="Errors of the estimates against ground truth, symmetries taken into account: "
        "median and 95th percentile, and the median share of the distance along the viewing ray.",
        columns=(
            *("estimator", "dataset", "estimates", "rotation, °", "95 %, °"),
            *("distance, mm", "95 %, mm", "along the ray"),
        ),
        rows=tuple(rows),
        numeric=(False, False, *(True for _ in range(6))),
    )


def _views(decisions: Decisions) -> Table | None:
    """Return success by the number of views that verdicts rest on; None without outcomes."""
    rows = []
    table = decisions.table
    for look in range(1, decisions.most_looks + 1):
        for views in table.filter(look=look)["views"].unique().sort().to_list():
            mine = table.filter(look=look, views=views)
            scores = rate_of(mine)
            if scores is None:
                continue
            error = mine["error_m"].median()
            rows.append(
                (
                    *(Cell.of(look), Cell.of(views), Cell.of(scores.n)),
                    interval_cell(scores.always),
                    Cell.of(None if error is None else 1e3 * float(error), 1),  # type: ignore[arg-type]
                    Cell.of(scores.attempt_rate.value),
                    interval_cell(scores.following),
                )
            )
    if not rows:
        return None
    return Table(
        key="views",
        caption="Verdicts by the number of looks allowed and of views they rest on: success rate "
        "if all are attempted, median distance of the guiding pose from the true one, and what the "
        "verdicts attempt.",
        columns=(
            *("looks allowed", "views", "grasps", "success always", "distance, mm"),
            *("attempted", "success of attempts"),
        ),
        rows=tuple(rows),
        numeric=tuple(True for _ in range(7)),
    )
