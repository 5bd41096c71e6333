"""The gallery: chosen cases with their facts and pictures."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, isfinite
from typing import Any

import polars as pl

from graspcast.estimates.outcomes import ERROR_COLUMNS
from graspcast.io.progress import Count, Progress
from graspcast.io.wording import counted
from graspcast.report.cases import choose_cases
from graspcast.report.content import Case, Mode, Section
from graspcast.report.error_sizes import obj_T_est
from graspcast.report.pictures import Painter
from graspcast.report.run_data import RunData
from graspcast.report.text import clean, rate

__all__ = ["gallery_section"]


def gallery_section(
    run: RunData, painter: Painter, most: int, progress: Progress | None = None
) -> Section:
    """Return the section of cases; empty without outcomes.

    Parameters
    ----------
    run
        The run.
    painter
        Draws the pictures.
    most
        Cases of each kind.
    progress
        Called with the share done, and words for it.
    """
    title = "Grasps to look at"
    if run.decisions is None or not run.has_outcomes or most < 1:
        return Section("cases", title)
    chosen = choose_cases(run.decisions, most)
    total, done, modes = sum(len(mode.rows) for mode in chosen), 0, []
    for mode in chosen:
        cases = []
        for row in mode.rows.iter_rows(named=True):
            if progress is not None:
                progress(done / total, Count(done, total, "cases drawn"))
            cases.append(_case(run, painter, row))
            done += 1
        modes.append(Mode(mode.key, mode.title, mode.text, tuple(cases), mode.of))
    return Section(
        key="cases",
        title=title,
        paragraphs=(
            "On the image, the pose that guides is green, the true pose solid where it is known. "
            "Beside it the same trial, run again in simulation: the object is orange, the estimate "
            "green. Choose a picture to see it larger, and go on with the arrow keys.",
        ),
        modes=tuple(modes),
    )


def _case(run: RunData, painter: Painter, row: Mapping[str, Any]) -> Case:
    assert run.decisions is not None
    number = int(row["row"])
    error = None
    if all(row[name] is not None and isfinite(row[name]) for name in ERROR_COLUMNS):
        error = obj_T_est(pl.DataFrame([{name: row[name] for name in ERROR_COLUMNS}]))[0]
    overlay = painter.overlay(row, run.decisions.poses[number], error)
    strip, words = painter.strip(row, int(run.decisions.trials_of[number]), error)
    outcome = words or row["outcome"] or ("success" if row["success"] else "failure")
    facts = [
        ("outcome", outcome),
        ("verdict", f"{row['said']}, {counted(row['views'], 'view')}"),
        ("probability", rate(row["probability"])),
        ("guide", f"{row['estimator']}, est_id {row['est_id']}"),
        ("grasp", f"{row['grasp']}, {row['gripper']} gripper"),
    ]
    if row["error_m"] is not None:
        off = f"{1e3 * row['error_m']:.1f} mm, {degrees(row['error_rad']):.1f}°"
        facts.append(("pose error", off))
    facts.append(("why", row["why"]))
    ended = row["outcome"] or ("succeeded" if row["success"] else "failed")
    where = f"{painter.label(row['object'])}, image {row['scene_id']}/{row['im_id']}"
    title = f"{ended[:1].upper()}{ended[1:]}: {where}"
    return Case(
        clean(title),
        tuple((name, clean(value)) for name, value in facts),
        (*overlay, *strip),
    )
