"""Options about several views of a scene, spelt the same in every verb."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspcast.cli.numbers import number_type
from graspcast.cli.options import maybe_named, positive
from graspcast.errors import GraspcastError, InputError

if TYPE_CHECKING:
    from graspcast.estimates.loading import Inputs
    from graspcast.forecasting.recorded_verdicts import ViewSettings
    from graspcast.views.camera_motion import CameraMotion

__all__ = [
    "add_policy",
    "add_views",
    "fusion_options",
    "motion_of_directory",
    "motions_of",
    "policy_options",
]


def add_views(
    verb: argparse.ArgumentParser, *, views_from: str, max_views: str = "", why: str = ""
) -> None:
    """``--camera-poses``, ``--camera-noise``, ``--views-from``, ``--min-parallax``.

    Parameters
    ----------
    verb
        Where to add them.
    views_from
        The default.
    max_views
        The help of ``--max-views``, which is left out if empty.
    why
        What camera poses are for, and what happens without.
    """
    verb.add_argument(
        "--camera-poses",
        metavar="PATH",
        type=maybe_named,
        action="append",
        default=[],
        help="the camera's pose in each image: a CSV whose header states direction and unit "
        "(world_T_cam_m), or a directory of scene folders with cam_R_w2c and cam_t_w2c in "
        "scene_camera.json; DATASET=PATH, once for each, if there are several datasets" + why,
    )
    verb.add_argument(
        "--camera-noise",
        metavar="LENGTH,ANGLE",
        default="0mm,0deg",
        help="standard deviation per axis of the motion between two images, with units: "
        "1mm,0.1deg (default: none)",
    )
    verb.add_argument(
        "--views-from",
        choices=("earlier", "all"),
        default=views_from,
        help="images of the scene that serve: with a smaller im_id, as for a robot, or all "
        f"(default: {views_from})",
    )
    if max_views:
        verb.add_argument("--max-views", metavar="N", type=positive, default=3, help=max_views)
    verb.add_argument(
        "--min-parallax",
        metavar="DEG",
        type=_degrees,
        default=12.0,
        help="least angle between any two views, seen from the object (default: 12)",
    )


def add_policy(verb: argparse.ArgumentParser, *, max_looks: str) -> None:
    """``--guide``, ``--max-looks`` and those of :func:`add_views`, for verdicts on several views.

    Parameters
    ----------
    verb
        Where to add them.
    max_looks
        The help of ``--max-looks``.
    """
    add_views(
        verb,
        views_from="earlier",
        max_views="at most this many images an instance, its own included (default: 3)",
        why="; the model must have been trained with them too (default: each image alone)",
    )
    verb.add_argument(
        "--guide",
        metavar="NAME",
        help="whose pose guides the grasp: an estimator's, fused (the pose fused from several "
        "views), or best, whichever has the highest probability (default: the model's principal)",
    )
    verb.add_argument("--max-looks", metavar="N", type=positive, default=1, help=max_looks)


def policy_options(options: argparse.Namespace) -> ViewSettings:
    """Return what the options of :func:`add_policy` say."""
    from graspcast.forecasting.recorded_verdicts import ViewSettings

    return ViewSettings(
        guide=options.guide,
        max_views=options.max_views,
        max_looks=options.max_looks,
        **fusion_options(options),
    )


_degrees = number_type(lambda value: 0 <= value <= 180, "degrees from 0 to 180 are")


def fusion_options(options: argparse.Namespace) -> dict[str, Any]:
    """Return what the options say about the fusion, but for the number of views."""
    from math import radians

    from graspcast.views.camera_motion import CameraNoise

    return {
        "noise": CameraNoise.parse(options.camera_noise),
        "views_from": options.views_from,
        "min_parallax_rad": radians(options.min_parallax),
    }


def motions_of(options: argparse.Namespace, inputs: Inputs) -> dict[str, CameraMotion]:
    """Read the camera motion of each dataset that ``--camera-poses`` names."""
    from graspcast.views.camera_tables import read_camera_motion

    given: list[tuple[str | None, Path]] = options.camera_poses
    out: dict[str, CameraMotion] = {}
    for name, path in given:
        if name is None and len(inputs.results) > 1:
            raise InputError(
                f"{path}: of which dataset are these camera poses? There are estimates of "
                f"{' and '.join(inputs.results)}: DATASET=PATH is needed",
                parameters=("camera_poses",),
            )
        dataset = name or next(iter(inputs.results))
        if dataset not in inputs.results:
            raise InputError(
                f"{path}: there are no estimates of {dataset}, but of "
                f"{' and '.join(inputs.results)}",
                parameters=("camera_poses",),
            )
        if dataset in out:
            raise InputError(
                f"{path}: there are already camera poses of {dataset}", parameters=("camera_poses",)
            )
        directory = inputs.datasets.get(dataset)
        out[dataset] = read_camera_motion(path, directory.sensor if directory else None)
    return out


def motion_of_directory(inputs: Inputs) -> CameraMotion:
    """Read the camera motion that the only BOP directory holds.

    Raises
    ------
    InputError
        If there is none.
    """
    from graspcast.views.camera_tables import read_camera_motion

    why = "there is no BOP directory that could hold them"
    try:
        for dataset in inputs.datasets.values():
            return read_camera_motion(dataset.scenes, dataset.sensor)
    except GraspcastError as error:
        why = str(error)
    raise InputError(
        f"fusing several views takes camera poses, and {why}; give them, or fuse the estimators of "
        "each image alone, with one view at most",
        parameters=("camera_poses", "max_views"),
    )
