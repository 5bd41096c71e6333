"""Fused poses of training instances, from which forecasts with several views are learned."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.errors import InputError, MismatchError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.loading import Inputs
from graspcast.views.camera_motion import CameraMotion, CameraNoise
from graspcast.views.choice import MIN_PARALLAX_RAD, ViewsFrom
from graspcast.views.fused_estimates import (
    FusedEstimates,
    checked_estimates,
    fuse_sane,
    view_rules,
)
from graspcast.views.spread import Spreads
from graspcast.views.statistics import fusion_statistics

__all__ = ["TRAINING_VIEWS", "ViewData", "fuse_by_views", "fuse_for_training", "view_data"]

TRAINING_VIEWS = (1, 2, 3, 5)
"""How many views at most each training instance is fused from, once each.

From one view alone the belief is learned that a further look would change.
"""


@dataclass(frozen=True, eq=False)
class ViewData:
    """Fused poses of some training instances, several of one instance with different views.

    Attributes
    ----------
    row
        Number of the training instance that each is of, (m,).
    cam_T_fused
        In that instance's camera frame, metres, (m, 4, 4).
    statistics
        :func:`~graspcast.views.statistics.fusion_statistics`, (m, d).
    views
        From how many views, (m,).
    estimators
        Those that were fused.
    rules
        Which views served and the noise of the camera motion, for the model card.
    """

    row: Int[ndarray, " m"]
    cam_T_fused: Float[ndarray, "m 4 4"]
    statistics: Float[ndarray, "m d"]
    views: Int[ndarray, " m"]
    estimators: tuple[str, ...]
    rules: Mapping[str, float]

    def __len__(self) -> int:
        return len(self.row)

    def select(self, which: Bool[ndarray, " n"] | Int[ndarray, " k"], count: int) -> ViewData:
        """Keep the fused poses of selected training instances, of ``count`` in all."""
        number = np.full(count, -1)
        chosen = np.flatnonzero(which) if which.dtype == bool else which
        number[chosen] = np.arange(len(chosen))
        kept = number[self.row] >= 0
        return ViewData(
            number[self.row[kept]],
            self.cam_T_fused[kept],
            self.statistics[kept],
            self.views[kept],
            self.estimators,
            self.rules,
        )


def view_data(
    estimates: Estimates, fused: Iterable[FusedEstimates], rules: Mapping[str, float]
) -> ViewData:
    """Join fused poses with training instances by key.

    Parameters
    ----------
    estimates
        The training instances.
    fused
        Fused poses of the same principal's instances.
    rules
        For the model card.

    Raises
    ------
    MismatchError
        If no instance has a pose from several views, or it is fused from other estimators.
    """
    number = {key: i for i, key in enumerate(estimates.instances.to_keys())}
    rows, poses, statistics, views = [], [], [], []
    for part in fused:
        if set(part.estimators) != set(estimates.estimators):
            raise MismatchError(
                f"poses are fused from {', '.join(part.estimators)}, but the training data have "
                f"estimates by {', '.join(estimates.estimators)}"
            )
        row = np.array([number.get(k, -1) for k in part.instances.to_keys()], dtype=np.int64)
        # What would have been from more views, and is from one, is already there.
        kept = (row >= 0) & ((part.views > 1) | (part.poses.used.shape[1] == 1))
        rows.append(row[kept])
        poses.append(part.poses.cam_T_obj[kept])
        statistics.append(fusion_statistics(part)[kept])
        views.append(part.views[kept])
    if not any((of > 1).any() for of in views):
        raise MismatchError(
            "no training instance has a pose from several views: are the camera poses of these "
            "scenes, and are there images from different sides?",
            parameters=("camera_poses",),
        )
    return ViewData(
        np.concatenate(rows),
        np.concatenate(poses),
        np.concatenate(statistics),
        np.concatenate(views),
        estimates.estimators,
        rules,
    )


def fuse_for_training(
    inputs: Inputs,
    motions: Mapping[str, CameraMotion],
    estimates: Estimates,
    principal: str,
    *,
    noise: CameraNoise | None = None,
    views_from: ViewsFrom = "all",
    min_parallax_rad: float = MIN_PARALLAX_RAD,
) -> ViewData:
    """Fuse the training instances of every dataset with camera motion from 1, 2, 3 and 5 views.

    Parameters
    ----------
    inputs
        All estimators' results; its notes get what is left out.
    motions
        Dataset's name to the camera motion of its scenes.
    estimates, principal
        The training instances, and whose they are.
    noise
        Of the camera motion.
    views_from
        ``all`` images of a scene, or ``earlier`` ones alone.
    min_parallax_rad
        Least angle between two views.

    Raises
    ------
    InputError, MismatchError
        As :func:`~graspcast.views.fused_estimates.fuse_estimates`; if no instance has several.
    """
    noise = noise or CameraNoise()
    fused = fuse_by_views(
        inputs,
        motions,
        estimates.estimators,
        principal,
        TRAINING_VIEWS,
        noise=noise,
        views_from=views_from,
        min_parallax_rad=min_parallax_rad,
    )
    for most, part in fused:
        if most == max(TRAINING_VIEWS):
            inputs.add_notes(part.gathered.single_views())
    rules = {
        "noise_m": noise.translation_m,
        "noise_rad": noise.rotation_rad,
        "min_parallax_rad": float(min_parallax_rad),
    }
    return view_data(estimates, [part for _, part in fused], rules)


def fuse_by_views(
    inputs: Inputs,
    motions: Mapping[str, CameraMotion],
    estimators: Sequence[str],
    principal: str,
    counts: Sequence[int],
    *,
    noise: CameraNoise | None = None,
    views_from: ViewsFrom = "earlier",
    min_parallax_rad: float = MIN_PARALLAX_RAD,
) -> list[tuple[int, FusedEstimates]]:
    """Fuse the principal's instances of every dataset with camera motion from so many views.

    Parameters
    ----------
    inputs
        All estimators' results; its notes get what is left out.
    motions
        Dataset's name to the camera motion of its scenes.
    estimators, principal
        Those to fuse, and whose instances.
    counts
        Numbers of views at most.
    noise, views_from, min_parallax_rad
        As for :func:`~graspcast.views.fused_estimates.fuse_estimates`.

    Returns
    -------
        Number of views at most, and the fused poses of one dataset.

    Raises
    ------
    InputError, MismatchError
        As :func:`~graspcast.views.fused_estimates.fuse_estimates`.
    """
    out = []
    for dataset, motion in motions.items():
        if dataset not in inputs.results:
            raise InputError(f"there is camera motion of {dataset}, but there are no estimates")
        tables = {name: inputs.results[dataset][name] for name in estimators}
        # Checked once, whatever the number of views.
        sane, notes = checked_estimates(
            tables, motion, [principal], dataset=dataset, models=inputs.models
        )
        for most in counts:
            part = fuse_sane(
                sane,
                motion,
                view_rules(views_from, most, min_parallax_rad, noise),
                Spreads(),
                dataset=dataset,
                principal=principal,
                models=inputs.models,
                notes=notes,
            )
            out.append((most, part))
        inputs.add_notes(part.notes)
    return out
