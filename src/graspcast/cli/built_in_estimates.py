"""The word ``built-in`` in place of results files: built-in estimators on the shipped tables."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

__all__ = ["InputFiles", "named", "named_or_built_in", "with_built_in"]

_WORD = "built-in"
_BUILT_IN = (_WORD, Path(_WORD))


class InputFiles(NamedTuple):
    """Results files by estimator, BOP directories and ground truth, as ``load_inputs`` takes them.

    Attributes
    ----------
    estimates, bop, ground_truth
        As for :func:`graspcast.estimates.loading.load_inputs`.
    """

    estimates: list[tuple[str, Path]]
    bop: list[tuple[str | None, Path]]
    ground_truth: list[Path]


def named(text: str) -> tuple[str, Path]:
    """Parse ``NAME=FILE``."""
    name, equals, path = text.partition("=")
    if not (name and equals and path):
        raise argparse.ArgumentTypeError(f"NAME=FILE is needed, not {text!r}")
    return name, Path(path)


def named_or_built_in(text: str) -> tuple[str, Path]:
    """Parse ``NAME=FILE``, or the word ``built-in``."""
    if text == _WORD:
        return _BUILT_IN
    if "=" not in text:
        raise argparse.ArgumentTypeError(f"NAME=FILE is needed, or {_WORD}, not {text!r}")
    return named(text)


def with_built_in(options: argparse.Namespace) -> InputFiles:
    """Return the files that the options name, with those that ``built-in`` stands for."""
    estimates, bop = list(options.estimates), list(options.bop)
    ground_truth = list(options.ground_truth)
    if _BUILT_IN not in estimates:
        return InputFiles(estimates, bop, ground_truth)
    from graspcast.cli.console import note
    from graspcast.cli.progress import progress_bar
    from graspcast.demo_data import demo_dataset
    from graspcast.simulation.campaign.shipped_estimates import shipped_estimates

    with progress_bar("the built-in estimators") as move:
        files = shipped_estimates(progress=move)
    tables = demo_dataset()
    note(
        f"built-in: {', '.join(files)} on the {len(tables.images)} shipped images of {tables.name}"
    )
    at = estimates.index(_BUILT_IN)
    estimates[at : at + 1] = files.items()
    bop.append((tables.name, tables.root))
    if ground_truth:
        ground_truth.append(tables.scenes)
    return InputFiles(estimates, bop, ground_truth)
