"""The verb ``reproduce``: the paper's tables beside ours."""

from __future__ import annotations

import argparse
from pathlib import Path

from graspcast.cli.console import print_text, progress_bar
from graspcast.cli.options import (
    Verbs,
    add_json,
    add_outcomes,
    new_verb,
    positive,
    write_json,
)

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``reproduce``."""
    verb = new_verb(
        verbs,
        "reproduce",
        _reproduce,
        "the paper's Tables I to III beside ours",
        "Print the paper's Tables I, II and III as paper | ours | difference, and below Table III\n"
        "the same networks by honest protocols, as Markdown.",
    )
    verb.add_argument(
        "--data",
        metavar="DIR",
        type=Path,
        required=True,
        help="holds published/ (what import-release writes), bop/, and raw/ if there is one",
    )
    verb.add_argument(
        "--seeds", metavar="N", type=positive, default=1, help="train with so many seeds"
    )
    add_outcomes(
        verb,
        required=False,
        what="outcomes of one's own (a campaign's directory) instead of the published ones",
    )
    add_json(verb)


def _reproduce(options: argparse.Namespace) -> None:
    from graspcast.paper.dataset import Published
    from graspcast.paper.render import render
    from graspcast.paper.tables import reproduce

    data = Published(options.data, outcomes=options.outcomes)
    with progress_bar("reading") as move:
        found = reproduce(
            data,
            seeds=options.seeds,
            progress=lambda name, done: move(done, f"training {name}"),
        )
    print_text(render(found))
    write_json(options.json, found)
