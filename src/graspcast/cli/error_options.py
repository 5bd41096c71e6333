"""Options of pose errors that no estimator has made: standard deviations and covariances."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from graspcast.errors import InputError

__all__ = ["add_covariance", "deviations_of", "told_deviations"]


def add_covariance(verb: argparse.ArgumentParser, what: str) -> None:
    """Add ``--deviations`` and ``--covariances``."""
    verb.add_argument(
        "--deviations",
        metavar=("ACROSS", "ALONG", "TURN"),
        nargs=3,
        type=_deviation,
        help="standard deviations of the position across (per axis) and along the viewing ray in\n"
        f"mm, and of the rotation per axis in degrees, {what}",
    )
    verb.add_argument(
        "--covariances",
        metavar="FILE",
        type=Path,
        help="instead, the table that graspcast fuse --covariances writes",
    )


def _deviation(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(
            f"a standard deviation above zero, in mm or degrees, is needed, not {text!r}"
        )
    return value


def deviations_of(options: argparse.Namespace) -> tuple[float, float, float] | None:
    """Return the standard deviations of ``--deviations`` in metres and radians, None without it.

    Raises
    ------
    InputError
        If there is a table of covariances too, or they are none of an estimate.
    """
    from graspcast.pose.covariances import check_deviations

    if options.deviations is None:
        return None
    if options.covariances is not None:
        raise InputError(
            "standard deviations and a table of covariances exclude each other",
            parameters=("deviations", "covariances"),
        )
    across, along, turn = options.deviations
    given = across / 1e3, along / 1e3, math.radians(turn)
    check_deviations(*given)
    return given


def told_deviations(given: tuple[float, float, float]) -> str:
    """Say standard deviations (m, m, rad) in words."""
    across, along, turn = given
    return (
        f"standard deviations of {1e3 * across:.3g} mm across and {1e3 * along:.3g} mm along the "
        f"viewing ray, and {math.degrees(turn):.3g}°"
    )
