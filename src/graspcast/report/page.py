"""The page of a report: HTML from its content, of limited size, that asks for nothing else."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from graspcast._version import __version__
from graspcast.errors import InputError
from graspcast.report.content import Cell, Run, Section, Table
from graspcast.report.text import clean

__all__ = ["MOST_BYTES", "Report", "render"]

MOST_BYTES = 8 * 1024**2
"""A report is smaller than this."""
_LEFT_OUT = "Pictures of some grasps are left out, so that the file stays below {} MB."


@dataclass(frozen=True)
class Report:
    """The content of a page.

    Attributes
    ----------
    title
        Of the page.
    runs
        One or several.
    written
        The time at which it was written, as text; empty for none. Nothing else in the page depends
        on when it is made.
    """

    title: str
    runs: tuple[Run, ...]
    written: str = ""


def render(report: Report, *, most_bytes: int = MOST_BYTES) -> str:
    """Return the page as HTML; pictures are left out where it would be too large.

    Raises
    ------
    InputError
        If it is too large without any picture.
    """
    page = _render(report)
    cases = max(
        (len(m.cases) for run in report.runs for s in run.sections for m in s.modes), default=0
    )
    while len(page.encode()) >= most_bytes and cases:
        cases -= 1
        page = _render(_with_fewer(report, cases, most_bytes))
    if len(page.encode()) >= most_bytes:
        size = len(page.encode()) / 1024**2
        raise InputError(
            f"the report would have {size:.1f} MB without any picture, and may have "
            f"{most_bytes / 1024**2:.3g}; report fewer runs"
        )
    return page


def _with_fewer(report: Report, cases: int, most_bytes: int) -> Report:
    """Return the report with pictures of so many cases of each kind at most."""
    told = _LEFT_OUT.format(f"{most_bytes / 1024**2:.3g}")
    runs = []
    for run in report.runs:
        keys = [(mode.key, cases) for section in run.sections for mode in section.modes]
        fewer = run.with_cases(keys)
        sections: list[Section] = [
            replace(s, paragraphs=(*s.paragraphs, told)) if s.modes else s for s in fewer.sections
        ]
        runs.append(replace(fewer, sections=tuple(sections)))
    return replace(report, runs=tuple(runs))


def _render(report: Report) -> str:
    environment = Environment(
        loader=PackageLoader("graspcast.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    # Style and scripts are ours, and hold nothing from files.
    style, early, script = (
        Markup(environment.get_template(name).render())
        for name in ("style.css", "early.js", "script.js")
    )
    page = environment.get_template("page.html").render(
        title=clean(report.title),
        runs=report.runs,
        comparison=_comparison(report.runs),
        written=report.written,
        version=__version__,
        policy=_policy(style, early, script),
        style=style,
        early=early,
        script=script,
    )
    return page.strip() + "\n"


def _policy(style: str, *scripts: str) -> str:
    """Return a content security policy: no address is asked, and no other script is run."""
    allowed = " ".join(_hash(script) for script in scripts)
    return (
        f"default-src 'none'; img-src data:; style-src {_hash(style)}; script-src {allowed}; "
        "base-uri 'none'; form-action 'none'"
    )


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _comparison(runs: Sequence[Run]) -> Table:
    """Return the main figures of several runs, side by side."""
    names = list(dict.fromkeys(what for run in runs for what, *_ in run.numbers))
    rows = []
    for run in runs:
        found = {what: (value, of) for what, value, of in run.numbers}
        cells = [Cell(run.name)]
        for name in names:
            value, of = found.get(name, ("-", ""))
            number = value.replace(",", "")
            as_number = float(number) if number.replace(".", "", 1).isdecimal() else None
            cells.append(Cell(f"{value} {of}".strip(), as_number))
        rows.append(tuple(cells))
    return Table(
        key="comparison",
        caption="The main figures of each run.",
        columns=("run", *names),
        rows=tuple(rows),
        numeric=(False, *(True for _ in names)),
    )
