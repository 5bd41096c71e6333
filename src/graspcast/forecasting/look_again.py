"""Look again: from where, and what success is expected after a further look.

The belief about the pose error are draws of the error model. A further look would change each of
them as a Kalman filter does: :func:`graspcast.views.next_look.further_view` gives gain and noise
from the fused covariance and typical spreads. Success given error judges what remains of the draws,
so the expected probability is that of a grasp guided by the pose fused with the further look.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.estimates.outcomes import REFERENCE_GRASP
from graspcast.forecasting.models.blend import Blend
from graspcast.forecasting.models.calibration import calibrated
from graspcast.pose.ray_frame import error_along, obj_R_ray, ray_frame
from graspcast.pose.transforms import norms
from graspcast.views.camera_motion import CameraNoise
from graspcast.views.fused_estimates import FusedEstimates
from graspcast.views.next_look import NextLook, further_view, next_looks

if TYPE_CHECKING:
    from graspcast.forecasting.forecaster import Forecaster

__all__ = ["MIN_GAIN", "expected_after", "looks_for"]

MIN_GAIN = 0.02
"""A further look pays if the expected probability after it is higher by this much."""
_DRAWS = 64


def looks_for(
    forecaster: Forecaster,
    fused: FusedEstimates,
    rows: Int[ndarray, " m"],
    statistics: Float[ndarray, "m d"],
    grasps: Sequence[str] | None = None,
    *,
    world: Mapping[tuple[int, int], Float[ndarray, "4 4"]] | None = None,
    noise: CameraNoise | None = None,
) -> list[NextLook]:
    """Return from where to look next at some instances, with the expected probability after it.

    Parameters
    ----------
    forecaster
        Trained with views; without, no probability is expected.
    fused
        Fused poses, also of one view.
    rows
        Numbers of the instances.
    statistics
        Of their fusions.
    grasps
        Names of the grasps; the reference grasps if None.
    world
        Scene and image to the camera's pose in the world, metres, for directions in its frame.
    noise
        Of the camera motion to the next look.
    """
    poses, gathered = fused.poses, fused.gathered
    keys = fused.instances.select(rows)
    images = zip(keys.scene_id.tolist(), keys.im_id.tolist(), strict=True)
    cameras = [(world or {}).get(image) for image in images]
    found = next_looks(
        poses.cam_T_obj[rows],
        poses.covariance[rows],
        cam_T_view=gathered.cam_T_view[rows],
        seen=gathered.present[rows].any(axis=2),
    )
    found = [
        look if camera is None else replace(look, direction_world=camera[:3, :3] @ look.direction)
        for look, camera in zip(found, cameras, strict=True)
    ]
    if forecaster.view_model is None:
        return found
    direction = np.stack([look.direction for look in found]) if found else np.empty((0, 3))
    expected = expected_after(forecaster, fused, rows, statistics, direction, grasps, noise=noise)
    return [
        replace(look, expected_probability=None if np.isnan(p) else p)
        for look, p in zip(found, expected.tolist(), strict=True)
    ]


def expected_after(
    forecaster: Forecaster,
    fused: FusedEstimates,
    rows: Int[ndarray, " m"],
    statistics: Float[ndarray, "m d"],
    direction: Float[ndarray, "m 3"],
    grasps: Sequence[str] | None = None,
    *,
    noise: CameraNoise | None = None,
) -> Float[ndarray, " m"]:
    """Return the expected probability of success after a further look, guided by the fused pose.

    Parameters
    ----------
    forecaster, fused, rows, statistics, grasps, noise
        As for :func:`looks_for`.
    direction
        From the objects to the camera of the further look, unit vectors in the camera's frame.

    Returns
    -------
    NaN for objects of which success given error is not known.
    """
    blend = forecaster.predictor
    assert isinstance(blend, Blend) and blend.views is not None
    out = np.full(len(rows), np.nan)
    objects = fused.instances.select(rows).objects.tolist()
    card = forecaster.card
    names = [REFERENCE_GRASP] * len(rows) if grasps is None else grasps
    # Where there was no forecast, and so no grasp was chosen, it is the first that is known.
    pairs = [
        (o, g if g in (k := card.grasps_of(o)) else k[0])
        for o, g in zip(objects, names, strict=True)
    ]
    numbers = np.array([int(card.targets.numbers([o], g)[0]) for o, g in pairs], dtype=np.int64)
    mine = np.flatnonzero((numbers >= 0) & blend.known[numbers])
    if blend.success_given_error is None or not len(mine):
        return out
    pose = fused.poses.cam_T_obj[rows[mine]]
    after = further_view(
        fused.poses.covariance[rows[mine]],
        pose,
        direction[mine],
        noise=noise,
        estimators=len(fused.estimators),
    )
    draws = blend.views.errors.draws(statistics[mine], _DRAWS)
    draws = _updated(draws, pose, after.gain, after.noise)
    errors = error_along(obj_R_ray(pose)[:, None], norms(pose[:, :3, 3]), draws)
    success = blend.success_given_error.probability(
        errors.reshape(-1, 4, 4), np.repeat(numbers[mine], _DRAWS)
    )
    expected = blend.views.calibrated(success.reshape(len(mine), _DRAWS).mean(axis=1))
    if (choice := blend.views.choice) is not None:
        several = [len(card.grasps_of(objects[i])) > 1 for i in mine.tolist()]
        expected = np.where(several, calibrated(expected, choice), expected)
    out[mine] = expected
    return out


def _updated(
    draws: Float[ndarray, "n d 6"],
    pose: Float[ndarray, "n 4 4"],
    gain: Float[ndarray, "n 6 6"],
    noise: Float[ndarray, "n 6 6"],
) -> Float[ndarray, "n d 6"]:
    """Return what remains of true poses in the fused poses' ray frames after a further view."""
    turn = np.zeros_like(gain)
    turn[:, :3, :3] = turn[:, 3:, 3:] = ray_frame(pose)
    back = np.swapaxes(turn, 1, 2)
    scale = np.ones((len(pose), 1, 6))
    scale[..., :3] = norms(pose[:, :3, 3])[:, None]
    metric = draws * scale
    # The same numbers for every instance, so a forecast does not depend on the others.
    normal = np.random.default_rng(0).standard_normal((draws.shape[1], 6))
    root = np.linalg.cholesky(noise)
    noisy = np.einsum("nij,njk,nkl,dl->ndi", back, gain, root, normal)
    kept = np.eye(6) - back @ gain @ turn
    return (np.einsum("nij,ndj->ndi", kept, metric) + noisy) / scale
