"""Errors that guide the trials of proposed grasps: of estimates, drawn, or a stated default."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import MismatchError
from graspcast.io.arguments import a, checked, whole
from graspcast.io.wording import counted
from graspcast.pose.ray_frame import error_along
from graspcast.pose.transforms import rotation_from_quaternion
from graspcast.simulation.campaign.pose_errors import PoseErrors
from graspcast.simulation.objects.types import GraspObject

__all__ = ["DEFAULT_DEVIATIONS", "GuidingErrors", "guiding_errors"]

DEFAULT_DEVIATIONS = (0.004, 0.010, np.deg2rad(5.0))
"""Standard deviations across and along the viewing ray (m) and of the rotation (rad), a choice."""

_FEWEST_OWN = 30


class GuidingErrors(NamedTuple):
    """Pose errors of an object, and where they come from.

    Attributes
    ----------
    obj_T_est
        Estimates in the true object's frame, (n, 4, 4).
    told
        Where they come from, in words.
    """

    obj_T_est: Float[ndarray, "n 4 4"]
    told: str


@checked(grasp_object=a(GraspObject), errors=a(PoseErrors), count=whole(1), seed=whole(0))
def guiding_errors(
    grasp_object: GraspObject, errors: PoseErrors | None = None, *, count: int = 200, seed: int = 0
) -> GuidingErrors:
    """Draw pose errors of an object, each seen from a random direction above the table.

    Parameters
    ----------
    grasp_object
        The object in its reference pose.
    errors
        The errors. Those made on this object are taken if there are 30 of them, else those made on
        other objects or on none. If None, errors are drawn with :data:`DEFAULT_DEVIATIONS`.
    count
        Number of errors.
    seed
        Random seed.

    Raises
    ------
    MismatchError
        If all errors were made on this object, and they are too few.
    """
    if errors is None:
        errors = PoseErrors.of_deviations(*DEFAULT_DEVIATIONS, seed=seed)
    name = grasp_object.name
    own = errors.objects == name
    mine = own.sum() >= _FEWEST_OWN
    rows = np.flatnonzero(own if mine else ~own)
    if not len(rows):
        raise MismatchError(
            f"there are {counted(int(own.sum()), 'error')} of estimates of {name} and none of "
            f"other objects; at least {_FEWEST_OWN} are needed",
            parameters=("estimates",),
        )
    rng = np.random.default_rng([seed, *name.encode()])
    rows = rng.choice(rows, count)
    turns = rng.standard_normal((count, 4))
    sim_R_ray = rotation_from_quaternion(turns / np.linalg.norm(turns, axis=1, keepdims=True))
    # The ray runs downwards; half a turn about x makes it do so.
    sim_R_ray[sim_R_ray[:, 2, 2] > 0] @= np.diag([1.0, -1.0, -1.0])
    axes = grasp_object.sim_T_ref[:3, :3].T @ sim_R_ray
    if (errors.objects != "").any():
        words = f"those of {', '.join(errors.sources)}, made on {name if mine else 'other objects'}"
    else:
        words = "; ".join(errors.sources.values())
    return GuidingErrors(error_along(axes, errors.distance_m[rows], errors.truth[rows]), words)
