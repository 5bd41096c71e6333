"""TODO."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from graspcast.cli.console import print_text

if TYPE_CHECKING:
    pass

__all__ = []


def _import_release(options: argparse.Namespace) -> None:
    from graspcast.paper.release import import_release

    for found in import_release(options.release, options.out):
        poses = ", ".join(f"{name} {n}" for name, n in found.estimates.items())
        print_text(
            f"{found.dataset}: poses {poses}; trials {found.trials}; instances {found.instances}, "
            f"of which {found.unseen} without a pose, since no estimator found them"
        )
