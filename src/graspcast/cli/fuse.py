"""The verb ``fuse``: one pose of each instance from several views and estimators."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_text
from graspcast.cli.options import Verbs, add_inputs, add_out, inputs_of, new_verb
from graspcast.cli.progress import progress_bar
from graspcast.cli.view_options import (
    add_views,
    fusion_options,
    motion_of_directory,
    motions_of,
)
from graspcast.errors import InputError

if TYPE_CHECKING:
    from graspcast.estimates.loading import Inputs
    from graspcast.views.motion import Motion

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``fuse``."""
    verb = new_verb(
        verbs,
        "fuse",
        _fuse,
        "one pose from several views and estimators",
        "Fuse the poses of one or more estimators over several images of a static scene, whose\n"
        "camera motion is known. Every instance of the principal's gets a pose in its own image's\n"
        "camera frame and a covariance. The output is a BOP results CSV, a further estimator for\n"
        "every other verb; its score is 1 / (1 + s / 10 mm), s the position's standard deviation.",
    )
    add_inputs(verb)
    verb.add_argument(
        "--principal",
        metavar="NAME",
        help="whose instances are fused (default: the first estimator)",
    )
    add_views(
        verb,
        views_from="earlier",
        max_views="at most this many images an instance, its own included; 1 fuses the estimators "
        "of each image alone (default: 3)",
        why=" (default: those of the BOP directory)",
    )
    verb.add_argument(
        "--motion-from",
        choices=("cameras", "estimates"),
        default="cameras",
        help="where the camera's motion is taken from: camera poses, or, where they are not known, "
        "the estimates of at least two other objects in both images, with their uncertainty "
        "(default: cameras)",
    )
    verb.add_argument(
        "--covariances",
        metavar="PATH",
        type=Path,
        help="write a table of covariances, spreads and what was dropped (CSV, or .parquet)",
    )
    add_out(verb, "the fused poses' BOP results CSV (fused_ycbv-test.csv states its dataset)")


def _fuse(options: argparse.Namespace) -> None:
    from graspcast.bop.results import write_results
    from graspcast.io.tables import write_table
    from graspcast.views.fused_estimates import fuse_estimates

    rules = fusion_options(options)
    inputs = inputs_of(options)
    if len(inputs.results) > 1:
        raise InputError(
            "a results file is of one dataset, but there are estimates of "
            f"{' and '.join(inputs.results)}; fuse one after the other",
            parameters=("estimates",),
        )
    ((dataset, results),) = inputs.results.items()
    motion = _motion(options, inputs)
    with progress_bar("fusing") as move:
        fused = fuse_estimates(
            results,
            motion,
            dataset=dataset,
            principal=options.principal,
            models=inputs.models,
            max_views=options.max_views,
            progress=move,
            **rules,
        )
    without = [] if dataset in inputs.datasets else ["without models (--bop), no symmetry is known"]
    if options.covariances:
        write_table(options.covariances, fused.table())
    write_results(options.out, fused.results)
    note(*inputs.notes, *fused.notes, *without, *inputs.lengths)
    print_text(f"{options.out}: {', '.join(fused.estimators)}; {fused.summary()[0]}")
    for line in fused.summary()[1:]:
        print_text(line)


def _motion(options: argparse.Namespace, inputs: Inputs) -> Motion | None:
    """Return the camera motion that is given, that of the BOP directory, or an estimate of it."""
    if options.motion_from == "estimates":
        if options.camera_poses:
            raise InputError(
                "the motion is either that of the camera poses or taken from estimates",
                parameters=("camera_poses", "motion_from"),
            )
        return _estimated(inputs) if options.max_views > 1 else None
    for motion in motions_of(options, inputs).values():
        return motion
    return None if options.max_views == 1 else motion_of_directory(inputs)


def _estimated(inputs: Inputs) -> Motion:
    from graspcast.views.object_motion import ObjectMotion

    ((dataset, results),) = inputs.results.items()
    return ObjectMotion.from_estimates(results, dataset=dataset, models=inputs.models)
