"""Options of what decides: models, a threshold or certificates, and at a robot guide and looks."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspcast.cli.options import positive, share
from graspcast.demo_data import model_path

if TYPE_CHECKING:
    from collections.abc import Sequence

    from graspcast.guarantees.certificate import Certificate
    from graspcast.runtime.watcher import Watcher

__all__ = ["add_models", "add_robot_policy", "add_threshold", "watcher_of"]


def add_models(verb: argparse.ArgumentParser) -> None:
    """Add ``--model``, which may be repeated."""
    verb.add_argument(
        "--model",
        metavar="PATH",
        type=model_path,
        action="append",
        required=True,
        help="from train, or demo, the demonstration's (a file of that name is ./demo); further "
        "ones, trained with fewer supporters, serve where a supporter is missing",
    )


def add_threshold(verb: argparse.ArgumentParser) -> None:
    """Add ``--threshold`` and ``--certificate``."""
    verb.add_argument(
        "--threshold",
        metavar="P",
        type=share,
        help="attempt at this probability or above it (default: 0.5)",
    )
    verb.add_argument(
        "--certificate",
        metavar="PATH",
        type=Path,
        action="append",
        default=[],
        help="from certify: its threshold instead; one for each model",
    )


def add_robot_policy(verb: argparse.ArgumentParser) -> None:
    """Add ``--guide`` and ``--max-looks``, as a :class:`~graspcast.runtime.watcher.Watcher` has."""
    verb.add_argument(
        "--guide",
        metavar="NAME",
        help="whose pose guides the grasp: an estimator's, fused (the pose fused from several "
        "views), or best, whichever has the highest probability (default: the model's principal)",
    )
    verb.add_argument(
        "--max-looks",
        metavar="N",
        type=positive,
        default=3,
        help="looks after which the decision is never to look again (default: 3)",
    )


def watcher_of(
    options: argparse.Namespace, certificates: Sequence[Certificate], **more: Any
) -> Watcher:
    """Return the watcher that the options describe; ``more`` are further ones of its own."""
    from graspcast.runtime.watcher import Watcher

    return Watcher.load(
        *options.model,
        threshold=options.threshold,
        certificate=list(certificates) or None,
        guide=options.guide,
        max_looks=options.max_looks,
        **more,
    )
