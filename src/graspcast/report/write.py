"""Writing of reports: from the files of runs to one HTML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.errors import InputError
from graspcast.evaluation.net_benefit import Costs
from graspcast.io.files import write_text
from graspcast.io.progress import Progress, step_of
from graspcast.report.content import Run
from graspcast.report.error_sizes import error_section
from graspcast.report.forecast_quality import forecast_section
from graspcast.report.gallery import gallery_section
from graspcast.report.missing import missing_of
from graspcast.report.page import Report, render
from graspcast.report.policies import policies_section, summarise_run
from graspcast.report.provenance import provenance_section
from graspcast.report.rates import rates_section
from graspcast.report.run_data import RunData, read_run
from graspcast.report.run_files import RunFiles
from graspcast.report.text import clean
from graspcast.report.thresholds import thresholds_section
from graspcast.report.tolerances import tolerance_section
from graspcast.report.verdict_list import verdicts_section
from graspcast.report.worth import worth_section

if TYPE_CHECKING:
    from graspcast.simulation.grippers.protocol import Gripper
    from graspcast.simulation.objects.catalogue import Catalogue

__all__ = ["write_report"]


def write_report(
    path: str | PathLike[str],
    runs: Sequence[RunFiles],
    *,
    cases: int = 3,
    costs: Costs | None = None,
    title: str = "",
    written: str = "",
    sensor: str | None = None,
    given: Sequence[str] = (),
    grippers: Mapping[str, Gripper] | None = None,
    catalogue: Catalogue | None = None,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """Write a report of one run or several, atomically.

    Parameters
    ----------
    path
        The HTML file.
    runs
        Their files.
    cases
        Grasps of each kind to be drawn; 0 for none.
    costs
        Of failures, skipped grasps and looks, at which thresholds are compared.
    title
        Of the page; from the names of the runs if empty.
    written
        The time, as text, that the page states; nothing else depends on when it is made.
    sensor, given
        As for :func:`graspcast.report.run_data.read_run`.
    grippers
        Custom grippers by name.
    catalogue
        Of the objects; the built-in one if None.
    progress
        Called with the share done, and words for it.

    Returns
    -------
        What could not be read, joined or drawn, in words.

    Raises
    ------
    InputError
        If a file is wrong, or the report cannot be written.
    """
    if not runs:
        raise InputError("there is no run to report")
    notes: list[str] = []
    content = []
    for number, files in enumerate(runs):
        step = step_of(progress, number, len(runs))
        step(0.0, f"reading {files.name}")
        data = read_run(files, sensor=sensor, given=given)
        content.append(_run(data, cases, costs or Costs(), grippers or {}, catalogue, step, notes))
        notes += data.problems
    names = " and ".join(run.name for run in content[:3])
    more = f" and {len(content) - 3} more" if len(content) > 3 else ""
    report = Report(title or f"Report on {names}{more}", tuple(content), written)
    write_text(Path(path), render(report))
    return tuple(dict.fromkeys(notes))


def _run(
    data: RunData,
    cases: int,
    costs: Costs,
    grippers: Mapping[str, Gripper],
    catalogue: Catalogue | None,
    progress: Progress,
    notes: list[str],
) -> Run:
    """Return what a report shows of a run; the notes get what could not be drawn."""
    from graspcast.report.pictures import Painter

    painter = Painter(data.datasets, data.trials, grippers, catalogue)
    progress(0.0, "scoring")
    sections = [worth_section(data)]
    lead, numbers = _of_trials(data), _numbers_of_trials(data)
    if data.decisions is not None:
        summary = summarise_run(data.decisions)
        lead, numbers = summary.lead, summary.numbers
        sections = [
            policies_section(data.decisions),
            rates_section(data.decisions),
            forecast_section(data.decisions, data.certificates.values()),
            thresholds_section(data.decisions, costs),
            error_section(data.trials, data.datasets),
            *sections,
            tolerance_section(data.tolerances),
            gallery_section(data, painter, cases, progress),
            verdicts_section(data.decisions),
        ]
    else:
        sections = [
            error_section(data.trials, data.datasets),
            *sections,
            tolerance_section(data.tolerances),
        ]
    painter.close()
    undrawn = tuple(f"{count} times: {text}" for text, count in painter.notes.items())
    notes += undrawn
    sections.append(provenance_section(data))
    return Run(
        name=clean(data.files.name),
        lead=lead,
        numbers=numbers,
        sections=tuple(section for section in sections if not section.is_empty),
        missing=missing_of(data, undrawn),
    )


def _of_trials(data: RunData) -> str:
    total = sum(len(one.table) for one in data.trials)
    held = sum(int(one.table["success"].sum()) for one in data.trials)
    return f"{total:,} trials, of which {held:,} succeed. There are no verdicts on them."


def _numbers_of_trials(data: RunData) -> tuple[tuple[str, str, str], ...]:
    total = sum(len(one.table) for one in data.trials)
    held = sum(int(one.table["success"].sum()) for one in data.trials)
    if not total:
        return ()
    return (
        ("trials", f"{total:,}", f"in {len(data.trials)} files"),
        ("succeed", f"{held / total:.3f}", f"{held:,} trials"),
    )
