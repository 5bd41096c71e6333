"""The verb ``fuse``: one pose of each instance from several views and estimators."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_text
from graspcast.cli.options import Verbs, add_inputs, add_out, inputs_of, new_verb, positive
from graspcast.errors import GraspcastError, InputError

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
    verb.add_argument(
        "--camera-poses",
        metavar="PATH",
        type=Path,
        help="the camera's pose in each image: a CSV whose header states direction and unit "
        "(world_T_cam_m), or a directory of scene folders with cam_R_w2c and cam_t_w2c in "
        "scene_camera.json (default: those of the BOP directory)",
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
        "--camera-noise",
        metavar="LENGTH,ANGLE",
        default="0mm,0deg",
        help="standard deviation per axis of the motion between two images, with units: "
        "1mm,0.1deg (default: none)",
    )
    _add_views(verb)
    verb.add_argument(
        "--covariances",
        metavar="PATH",
        type=Path,
        help="write a table of covariances, spreads and what was dropped (CSV, or .parquet)",
    )
    add_out(verb, "the fused poses' BOP results CSV (fused_ycbv-test.csv states its dataset)")


def _add_views(verb: argparse.ArgumentParser) -> None:
    """Add the options that say which images serve."""
    verb.add_argument(
        "--views-from",
        choices=("earlier", "all"),
        default="earlier",
        help="images of the scene that serve: with a smaller im_id, as for a robot, or all "
        "(default: earlier)",
    )
    verb.add_argument(
        "--max-views",
        metavar="N",
        type=positive,
        default=3,
        help="at most this many images an instance, its own included; 1 fuses the estimators of "
        "each image alone (default: 3)",
    )
    verb.add_argument(
        "--min-parallax",
        metavar="DEG",
        type=_degrees,
        default=12.0,
        help="least angle between any two views, seen from the object (default: 12)",
    )


def _degrees(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value <= 180:
        raise argparse.ArgumentTypeError(f"degrees from 0 to 180 are needed, not {text!r}")
    return value


def _fuse(options: argparse.Namespace) -> None:
    from math import radians

    from graspcast.bop.results import write_results
    from graspcast.io.tables import write_table
    from graspcast.views.camera_motion import CameraNoise
    from graspcast.views.fused_estimates import fuse_estimates

    noise = CameraNoise.parse(options.camera_noise)
    inputs = inputs_of(options)
    if len(inputs.results) > 1:
        raise InputError(
            "a results file is of one dataset, but there are estimates of "
            f"{' and '.join(inputs.results)}; fuse one after the other",
            parameters=("estimates",),
        )
    ((dataset, results),) = inputs.results.items()
    fused = fuse_estimates(
        results,
        _motion(options, inputs),
        dataset=dataset,
        principal=options.principal,
        models=inputs.models,
        noise=noise,
        views_from=options.views_from,
        max_views=options.max_views,
        min_parallax_rad=radians(options.min_parallax),
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
    """Read the camera motion that is given, or that of the BOP directory, or estimate it."""
    from graspcast.views.camera_tables import read_camera_motion

    if options.motion_from == "estimates":
        if options.camera_poses:
            raise InputError(
                "the motion is either that of the camera poses or taken from estimates",
                parameters=("camera_poses", "motion_from"),
            )
        return _estimated(inputs) if options.max_views > 1 else None
    if options.camera_poses:
        return read_camera_motion(options.camera_poses)
    if options.max_views == 1:
        return None
    tried = [dataset.scenes for dataset in inputs.datasets.values()]
    why = "there is no BOP directory that could hold them"
    try:
        for scenes in tried:
            return read_camera_motion(scenes)
    except GraspcastError as error:
        why = str(error)
    raise InputError(
        f"fusing several views takes camera poses, and {why}; give them, or fuse the estimators of "
        "each image alone, with one view at most",
        parameters=("camera_poses", "max_views"),
    )


def _estimated(inputs: Inputs) -> Motion:
    from graspcast.views.object_motion import ObjectMotion

    ((dataset, results),) = inputs.results.items()
    return ObjectMotion.from_estimates(results, dataset=dataset, models=inputs.models)
