"""TODO."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from graspcast.cli.console import print_text, progress_bar
from graspcast.cli.options import (
    write_json,
)

if TYPE_CHECKING:
    pass

__all__ = []


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
