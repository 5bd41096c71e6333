"""Options of pose errors that no estimator has made: standard deviations and covariances."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.numbers import number_type
from graspcast.errors import InputError

if TYPE_CHECKING:
    from graspcast.simulation.campaign.pose_errors import PoseErrors

__all__ = ["add_covariance", "add_tails", "deviations_of", "drawn_errors", "told_deviations"]

_LEAST_MM = 0.05


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


def add_tails(verb: argparse.ArgumentParser) -> None:
    """Add ``--tails``."""
    verb.add_argument(
        "--tails",
        metavar="N",
        type=_tails,
        help="degrees of freedom of Student's t distribution, of which such errors are drawn:\n"
        "above 2, the fewer the more gross errors; inf for a normal distribution (default: 4)",
    )


_tails = number_type(lambda value: value > 2, "degrees of freedom above 2, or inf, are")


_deviation = number_type(
    lambda value: 0 < value < math.inf, "a standard deviation above zero, in mm or degrees, is"
)


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
    if max(across, along) < _LEAST_MM:
        raise InputError(
            f"standard deviations of {across:g} and {along:g} mm are less than any estimator's; "
            "are they in metres and radians? Give millimetres and degrees",
            parameters=("deviations",),
        )
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


def drawn_errors(options: argparse.Namespace) -> PoseErrors | None:
    """Return errors drawn by ``--deviations`` or ``--covariances``, None without both.

    Raises
    ------
    InputError
        If there are estimates too, or tails without anything to draw.
    """
    from graspcast.simulation.campaign.pose_errors import TAILS, PoseErrors
    from graspcast.views.covariance_table import read_covariances

    deviations = deviations_of(options)
    if deviations is None and options.covariances is None:
        if options.tails is not None:
            raise InputError(
                "tails are of errors that are drawn; give their standard deviations",
                parameters=("tails", "deviations"),
            )
        return None
    if options.estimates:
        raise InputError(
            "errors are either those of estimates or drawn: give one or the other",
            parameters=("estimates", "deviations", "covariances"),
        )
    how = {"tails": TAILS if options.tails is None else options.tails, "seed": options.seed}
    if deviations is None:
        return PoseErrors.of_covariances(read_covariances(options.covariances), **how)
    return PoseErrors.of_deviations(*deviations, **how)
