"""The verb ``tolerance``: how far off the pose of a grasp may be."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_table, print_text
from graspcast.cli.error_options import add_covariance, deviations_of, told_deviations
from graspcast.cli.options import (
    Verbs,
    add_bop,
    add_json,
    add_pair,
    bop_dirs_of,
    count,
    new_verb,
    note_sizes,
    positive,
    write_json,
)
from graspcast.cli.progress import progress_bar
from graspcast.cli.protocol_options import add_protocol, settings_of
from graspcast.errors import InputError

if TYPE_CHECKING:
    from jaxtyping import Float
    from numpy import ndarray

    from graspcast.simulation.grasps.fall_off import Bounds
    from graspcast.simulation.grasps.tolerance import Reach, Tolerance

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``tolerance``."""
    verb = new_verb(
        verbs,
        "tolerance",
        _tolerance,
        "how far off the pose of a grasp may be, in each direction",
        "Simulate grasps at wrong poses, and print how far off the pose may be in each direction\n"
        "of the grasp's frame and about each axis until 90 and 50 % of the trials succeed, with\n"
        "90 % intervals; and by which factor the standard deviations of an estimate may grow.",
    )
    add_pair(verb, "ycbv-5")
    verb.add_argument(
        "--grasp", metavar="NAME", help="its name, if there are several (default: the reference)"
    )
    verb.add_argument("--grasps", metavar="FILE", type=Path, help="own grasps (TOML)")
    verb.add_argument("--catalogue", metavar="FILE", type=Path, help="own objects (TOML)")
    add_bop(verb)
    add_covariance(verb, "of the estimate that the scale is of (default: 1 mm and 1° per axis)")
    add_protocol(verb)
    verb.add_argument(
        "--trials",
        metavar="N",
        type=positive,
        default=24,
        help="in each direction, at least 8; 16 times as many in all (default: 24)",
    )
    verb.add_argument("--seed", metavar="N", type=count, default=0, help="random seed (default: 0)")
    add_json(verb)
    verb.add_argument("--out", metavar="FILE", type=Path, help="a figure (.png)")


def _tolerance(options: argparse.Namespace) -> None:
    from graspcast.simulation.grasps.table import read_grasps
    from graspcast.simulation.grasps.tolerance import measure_tolerance
    from graspcast.simulation.grippers import load_gripper
    from graspcast.simulation.objects.catalogue import read_catalogue
    from graspcast.simulation.objects.load import load_object
    from graspcast.simulation.trial.trial import TrialRunner

    if options.out is not None and options.out.suffix.lower() != ".png":
        raise InputError(f"{options.out}: the figure is a .png file", parameters=("out",))
    catalogue = read_catalogue(options.catalogue)
    name = catalogue[options.object].name
    gripper = load_gripper(options.gripper)
    reference = read_grasps(options.grasps, protocol=options.protocol)(
        name, gripper.name, options.grasp
    )
    covariance = _covariance(options, name)
    target = load_object(name, bop_dirs=bop_dirs_of(options), catalogue=catalogue)
    runner = TrialRunner(reference.applied_to(target), gripper, settings_of(options, gripper))
    note_sizes([runner.grasp_object], [gripper])
    with progress_bar("measuring") as move:
        found = measure_tolerance(
            runner,
            reference.grasp,
            covariance=covariance,
            trials=options.trials,
            seed=options.seed,
            progress=move,
        )
    _print(found, given=covariance is not None)
    write_json(options.json, found.as_dict())
    if options.out is not None:
        from graspcast.rendering.trials.tolerance_figure import save_tolerance_figure

        save_tolerance_figure(options.out, found)
        print_text(str(options.out))


def _covariance(options: argparse.Namespace, name: str) -> Float[ndarray, "6 6"] | None:
    """Return the covariance that the options give, in the object's axes; None for the default."""
    from graspcast.pose.covariances import covariance_from_any_side
    from graspcast.views.covariance_table import read_covariances

    given = deviations_of(options)
    if options.covariances is not None:
        mine = read_covariances(options.covariances).of(name)
        note(f"{mine.source}: the mean of {len(mine)} covariances of {name}")
        return mine.mean()
    if given is None:
        return None
    note(f"{told_deviations(given)}, seen from any side")
    return covariance_from_any_side(*given)


def _print(found: Tolerance, *, given: bool) -> None:
    rows = [_row(*pair) for pair in zip(found.reaches[::2], found.reaches[1::2], strict=True)]
    deviations = [
        _told(bounds, reach)
        for bounds, reach in zip(found.deviations, found.reaches[::2], strict=True)
    ]
    print_table(
        f"Tolerance of {found.grasp}",
        ["error", "90 % back", "90 % forth", "50 % back", "50 % forth", "deviation"],
        [[*row, deviation] for row, deviation in zip(rows, deviations, strict=True)],
    )
    print_text(f"at the true pose {found.held} of {found.of} succeed (jitter of 1 mm and 1°)")
    if not found.held:
        note(
            "the grasp does not even hold at the true pose, so nothing is tolerated; graspcast "
            "grasps shows why"
        )
    print_text(found.summary())
    scale = found.scale
    what = "the given standard deviations" if given else "1 mm and 1° per axis"
    print_text(
        f"all at once: 90 % succeed at {scale.value:.2g} [{scale.low:.2g}, {scale.high:.2g}] times "
        f"{what}; under these themselves, {found.as_given.value:.2f} "
        f"[{found.as_given.low:.2f}, {found.as_given.high:.2f}]"
    )


def _row(back: Reach, forth: Reach) -> list[str]:
    preposition = "along" if back.kind == "shift" else "about"
    letter = "xyz"[("closing", "across", "approach").index(back.axis)]
    cells = [_told(getattr(r, level), r) for level in ("ninety", "half") for r in (back, forth)]
    return [f"{preposition} {letter} ({back.axis})", *cells]


def _told(bounds: Bounds, reach: Reach) -> str:
    from math import degrees

    shift = reach.kind == "shift"
    value, low, high = (1e3 * b if shift else degrees(b) for b in bounds)
    unit = " mm" if shift else "°"
    if bounds.value >= reach.limit:
        return f"over {value:.0f}{unit}"
    return f"{value:.1f}{unit} [{low:.1f}, {high:.1f}]"
