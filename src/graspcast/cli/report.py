"""The verb ``report``: one HTML file on what was judged, by what, and how well."""

from __future__ import annotations

import argparse
import os
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspcast.cli.console import note, print_text
from graspcast.cli.cost_options import add_costs, costs_of
from graspcast.cli.options import (
    Verbs,
    add_bop,
    add_estimates,
    add_out,
    add_outcomes,
    count,
    new_verb,
    note_software_drawing,
)
from graspcast.cli.progress import progress_bar
from graspcast.errors import InputError

if TYPE_CHECKING:
    from graspcast.report.run_files import RunFiles

__all__ = ["add"]

_KINDS = {
    "verdicts": "verdicts",
    "stages": "stages",
    "outcomes": "outcomes",
    "estimates": "estimates",
    "bop": "bop",
    "ground_truth": "ground_truth",
    "model": "models",
    "certificate": "certificates",
    "tolerance": "tolerances",
}
_FOR_ALL = ("bop", "ground_truth")


def add(verbs: Verbs) -> None:
    """Add the verb ``report``."""
    verb = new_verb(
        verbs,
        "report",
        _report,
        "one HTML file on what was judged, by what, and how well",
        "Write a report that needs nothing else: success rates, risk-coverage, reliability, pose\n"
        "errors against success, what estimators and views are worth, tolerances, pictures of\n"
        "grasps, and the data of every figure as CSV. A RUN is a directory, such as\n"
        "graspcast-demo, whose files are recognised by what they hold. Files that options name\n"
        "replace those of the same kind in RUN, or are all there is. What is missing is left out,\n"
        "and the report says how to get it. Several RUNs are compared.",
    )
    verb.add_argument("runs", metavar="RUN", type=Path, nargs="*", help="directories of runs")
    verb.add_argument(
        "--verdicts",
        metavar="FILE",
        type=Path,
        action="append",
        default=[],
        help="what predict wrote; may be repeated: after one look, two, and so on",
    )
    verb.add_argument(
        "--stages",
        metavar="FILE",
        type=Path,
        action="append",
        default=[],
        help="the verdicts after each look, from predict --stages",
    )
    add_outcomes(verb, required=False)
    add_estimates(verb, required=False)
    add_bop(verb)
    for name, what in (
        ("model", "from train; may be repeated"),
        ("certificate", "from certify; may be repeated"),
        ("tolerance", "from tolerance --json; may be repeated"),
    ):
        verb.add_argument(
            f"--{name}", metavar="FILE", type=Path, action="append", default=[], help=what
        )
    verb.add_argument(
        "--gripper",
        metavar="FILE",
        type=Path,
        action="append",
        default=[],
        help="the .toml file of a custom gripper, for pictures; may be repeated",
    )
    verb.add_argument("--catalogue", metavar="FILE", type=Path, help="own objects (TOML)")
    verb.add_argument(
        "--cases",
        metavar="N",
        type=count,
        default=3,
        help="grasps of each kind to be drawn; 0 draws none (default: 3)",
    )
    add_costs(verb)
    verb.add_argument("--title", metavar="TEXT", default="", help="of the page")
    add_out(verb, "the report (.html)")
    verb.set_defaults(positional={"runs": "RUN"})


def _report(options: argparse.Namespace) -> None:
    from graspcast.report.write import write_report
    from graspcast.simulation.grippers import load_grippers
    from graspcast.simulation.objects.catalogue import read_catalogue

    if options.out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{options.out}: a report is an .html file", parameters=("out",))
    runs, written = _runs(options), _written()
    if options.cases:
        note_software_drawing()
    with progress_bar("report") as move:
        notes = write_report(
            options.out,
            runs,
            cases=options.cases,
            costs=costs_of(options),
            title=options.title,
            written=written,
            sensor=options.sensor,
            given=[kind for name, kind in _KINDS.items() if getattr(options, name)],
            grippers=load_grippers(options.gripper),
            catalogue=read_catalogue(options.catalogue),
            progress=move,
        )
    note(*notes)
    print_text(str(options.out))


def _runs(options: argparse.Namespace) -> list[RunFiles]:
    """Return the files of each run: those of its directory, and those that were named."""
    from graspcast.report.run_files import RunFiles, find_run

    named: dict[str, Any] = {k: tuple(getattr(options, name)) for name, k in _KINDS.items()}
    given = RunFiles(name="these files", **named)
    if not options.runs:
        if not any(named.values()):
            raise InputError(
                "name a RUN, or files: graspcast report graspcast-demo --out report.html",
                parameters=("verdicts", "stages", "outcomes"),
            )
        return [given]
    if len(options.runs) > 1:
        alone = [name for name in _KINDS if getattr(options, name) and name not in _FOR_ALL]
        if alone:
            raise InputError(
                f"--{alone[0].replace('_', '-')} is of one run, and there are {len(options.runs)}; "
                "put the file into the directory of its run"
            )
    return [find_run(path).with_given(given) for path in options.runs]


def _written() -> str:
    """Return the time to state, which SOURCE_DATE_EPOCH pins."""
    pinned = os.environ.get("SOURCE_DATE_EPOCH", "")
    if not pinned:
        return datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    try:
        return datetime.fromtimestamp(int(pinned), UTC).strftime("%Y-%m-%d %H:%M UTC")
    except (ValueError, OverflowError, OSError) as error:
        raise InputError(
            f"SOURCE_DATE_EPOCH is {pinned!r}, not a number of seconds since 1970"
        ) from error
