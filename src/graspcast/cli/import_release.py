"""The verb ``import-release``: the paper authors' release as BOP files."""

from __future__ import annotations

import argparse
from pathlib import Path

from graspcast.cli.console import print_text
from graspcast.cli.options import (
    Verbs,
    new_verb,
)

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``import-release``."""
    verb = new_verb(
        verbs,
        "import-release",
        _import_release,
        "convert the paper authors' release to BOP files",
        "Convert a checkout of the paper authors' repository to BOP results CSVs, ground truth,\n"
        "outcomes and split, one directory per dataset. Poses are converted exactly. Where scenes\n"
        "are static, the camera's motion is written too (camera_motion/).",
    )
    verb.add_argument("release", metavar="RELEASE_DIR", type=Path, help="the checkout")
    verb.add_argument(
        "out", metavar="OUT_DIR", type=Path, help="directory in which lmo/ and ycbv/ are created"
    )


def _import_release(options: argparse.Namespace) -> None:
    from graspcast.paper.release import import_release

    for found in import_release(options.release, options.out):
        poses = ", ".join(f"{name} {n}" for name, n in found.estimates.items())
        print_text(
            f"{found.dataset}: poses {poses}; trials {found.trials}; instances {found.instances}, "
            f"{found.unseen} of them without a pose, since no estimator found them"
        )
