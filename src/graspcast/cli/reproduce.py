"""The verb ``reproduce``: the paper's tables and ours."""

from __future__ import annotations

import argparse
from pathlib import Path

from graspcast.cli.console import note, print_text
from graspcast.cli.options import (
    Verbs,
    add_json,
    add_outcomes,
    new_verb,
    positive,
    write_json,
)
from graspcast.cli.progress import progress_bar

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``reproduce``."""
    verb = new_verb(
        verbs,
        "reproduce",
        _reproduce,
        "reproduce the paper's Tables I to III",
        "Print the paper's Tables I, II and III as paper | ours | difference, and the networks of\n"
        "Table III without selection on the test set, as Markdown.",
    )
    verb.add_argument(
        "--data",
        metavar="DIR",
        type=Path,
        required=True,
        help="holds published/ (what import-release writes), bop/, and raw/ if there is one",
    )
    verb.add_argument(
        "--seeds",
        metavar="N",
        type=positive,
        default=1,
        help="number of seeds to train with (default: 1)",
    )
    add_outcomes(
        verb,
        required=False,
        what="your own outcomes (a campaign's directory) in place of the published ones",
    )
    add_json(verb)


def _reproduce(options: argparse.Namespace) -> None:
    from graspcast.paper.dataset import Published
    from graspcast.paper.render import render
    from graspcast.paper.tables import reproduce

    data = Published(options.data, outcomes=options.outcomes)
    with progress_bar("reading") as move:
        found = reproduce(data, seeds=options.seeds, progress=move)
    note(*data.lengths)
    print_text(render(found))
    write_json(options.json, found)
