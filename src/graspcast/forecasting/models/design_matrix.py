"""The design matrix: training data as arrays of numbers, from which forests are grown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.estimates.instances import scene_groups
from graspcast.estimates.matching import nearest_truth
from graspcast.forecasting.features import consensus_features
from graspcast.forecasting.models.targets import Targets
from graspcast.forecasting.training_data import TrainingData
from graspcast.forecasting.view_data import ViewData
from graspcast.pose.ray_frame import relative
from graspcast.pose.transforms import compose, invert

__all__ = ["DesignMatrix", "ViewMatrix", "nearest_to"]

_ROUNDING = 1e-9


def nearest_to(
    cam_T_guide: Float[ndarray, "n 4 4"],
    cam_T_fused: Float[ndarray, "n 4 4"],
    dataset: ndarray,
    obj_id: Int[ndarray, " n"],
    models: Mapping[str, Models],
) -> Float[ndarray, "n 4 4"]:
    """Return of the poses equivalent to fused ones those nearest to the poses that guide."""
    between = compose(invert(cam_T_guide), cam_T_fused)
    return compose(cam_T_guide, nearest_truth(between, dataset, obj_id, models))


@dataclass(frozen=True, eq=False)
class ViewMatrix:
    """Poses fused from several views as arrays, for each guiding estimator.

    Attributes
    ----------
    row
        Number of the instance that each is of, (m,).
    statistics
        Of the fusions, (m, d).
    truth
        True pose in each fused pose's ray frame, NaN where unknown, (m, 6).
    fused
        Of the equivalent fused poses the nearest to the guide's pose, (K + L, m, 4, 4).
    guide
        The guide's pose, NaN where an estimator that is only learned from has none,
        (K + L, m, 4, 4).
    views
        From how many views, (m,).
    """

    row: Int[ndarray, " m"]
    statistics: Float[ndarray, "m d"]
    truth: Float[ndarray, "m 6"]
    fused: Float[ndarray, "k m 4 4"]
    guide: Float[ndarray, "k m 4 4"]
    views: Int[ndarray, " m"]

    @classmethod
    def of(
        cls, training_data: TrainingData, views: ViewData, models: Mapping[str, Models]
    ) -> ViewMatrix:
        """Compute the arrays from the fused poses of training data."""
        estimates, row = training_data.estimates, views.row
        of = (estimates.dataset[row], estimates.obj_id[row], models)
        poses = views.cam_T_fused
        fused_T_true = compose(invert(poses), training_data.truth[row])
        true = compose(poses, nearest_truth(fused_T_true, *of))
        known = np.isfinite(true).all(axis=(1, 2))
        truth = np.full((len(row), 6), np.nan)
        truth[known] = relative(poses[known], true[known])
        guide = estimates.cam_T_obj[:, row]
        if training_data.learned is not None:
            guide = np.concatenate([guide, training_data.learned.cam_T_obj[:, row]])
        fused = np.stack([nearest_to(one, poses, *of) for one in guide])
        return cls(row, views.statistics, truth, fused, guide, views.views)


@dataclass(frozen=True, eq=False)
class DesignMatrix:
    """Training data as arrays: features, outcomes and pose errors for each guiding estimator.

    Of K estimators that are needed at run time, and L whose outcomes are learned from alone, and of
    S names of grasps.

    Attributes
    ----------
    principal
        Number of the principal among the K estimators.
    names
        Names of the principal's features, in the order of every guide's; none if it has no
        supporter.
    features
        The set ``full`` with each estimator in turn as the principal, (K, n, d).
    success
        Outcomes of each grasp: 1, 0, or NaN, (S, K, n).
    truth
        True pose in each estimate's ray frame (:func:`graspcast.pose.ray_frame.relative`), NaN
        where unknown, (K, n, 6).
    obj_T_est
        Pose errors, up to the object's symmetries, (K, n, 4, 4).
    numbers
        The target of each grasp and instance, -1 where it is none of the targets, (S, n).
    groups
        Each instance's scene (or block of frames), (n,).
    targets
        The grasps of each object.
    simulated
        Pose errors, targets and outcomes of simulated trials of these.
    views
        Poses fused from several views, or None.
    learned_success, learned_obj_T_est
        The same of the estimators that are learned from alone, (S, L, n) and (L, n, 4, 4), or None.
    """

    principal: int
    names: tuple[str, ...]
    features: Float[ndarray, "k n d"]
    success: Float[ndarray, "s k n"]
    truth: Float[ndarray, "k n 6"]
    obj_T_est: Float[ndarray, "k n 4 4"]
    numbers: Int[ndarray, "s n"]
    groups: ndarray
    targets: Targets
    simulated: tuple[ndarray, ndarray, ndarray] | None
    views: ViewMatrix | None = None
    learned_success: Float[ndarray, "s l n"] | None = None
    learned_obj_T_est: Float[ndarray, "l n 4 4"] | None = None

    @property
    def all_success(self) -> Float[ndarray, "s j n"]:
        """Outcomes of all estimators, those that are learned from alone last, (S, K + L, n)."""
        if self.learned_success is None:
            return self.success
        return np.concatenate([self.success, self.learned_success], axis=1)

    @property
    def all_errors(self) -> Float[ndarray, "j n 4 4"]:
        """Pose errors of all estimators, in the same order, (K + L, n, 4, 4)."""
        if self.learned_obj_T_est is None:
            return self.obj_T_est
        return np.concatenate([self.obj_T_est, self.learned_obj_T_est])

    @property
    def own(self) -> Float[ndarray, "n d"]:
        """The principal's features."""
        return self.features[self.principal]

    @property
    def is_tried(self) -> Bool[ndarray, " n"]:
        """Which instances have an outcome of a grasp that the principal guided."""
        return np.asarray(~np.isnan(self.success[:, self.principal]).all(axis=0))

    @classmethod
    def of(
        cls, training_data: TrainingData, targets: Targets, models: Mapping[str, Models]
    ) -> DesignMatrix:
        """Compute the arrays once, for all forests that are grown from parts of them."""
        estimates = training_data.estimates
        # Instances of other objects still train the error model.
        names_of = estimates.objects.tolist()
        numbers = np.stack([targets.numbers(names_of, grasp) for grasp in training_data.grasps])
        names: tuple[str, ...] = ()
        features, truths, errors = [], [], []
        stored = training_data.obj_T_est
        for k, name in enumerate(estimates.estimators):
            if len(estimates.estimators) > 1:
                found = consensus_features(estimates, name, which="full", models=models)
                names = found.names if name == training_data.principal else names
                features.append(found.values)
            else:  # nobody to agree with
                features.append(np.zeros((len(estimates), 0)))
            poses = estimates.of(name)
            stated = None if stored is None else stored[k]
            est_T_true = _true_poses(poses, stated, training_data, models)
            known = np.isfinite(est_T_true).all(axis=(1, 2))
            near = compose(poses, est_T_true)
            truths.append(np.full((len(near), 6), np.nan))
            truths[-1][known] = relative(poses[known], near[known])
            errors.append(invert(est_T_true))
        simulated = views = learned_success = learned_errors = None
        if (learned := training_data.learned) is not None:
            learned_success = learned.success[None]
            stated = (
                [None] * len(learned.success) if learned.obj_T_est is None else learned.obj_T_est
            )
            truth = [
                _true_poses(of, error, training_data, models)
                for of, error in zip(learned.cam_T_obj, stated, strict=True)
            ]
            learned_errors = np.stack([invert(one) for one in truth])
        if training_data.views is not None:
            views = ViewMatrix.of(training_data, training_data.views, models)
        if training_data.simulated is not None:
            trials = training_data.simulated
            number = trials.targets(targets)
            mine = number >= 0
            simulated = (trials.obj_T_est[mine], number[mine], trials.success[mine])
        return cls(
            estimates.index(training_data.principal),
            names,
            np.stack(features),
            training_data.every_success,
            np.stack(truths),
            np.stack(errors),
            numbers,
            scene_groups(estimates.instances),
            targets,
            simulated,
            views,
            learned_success,
            learned_errors,
        )


def _true_poses(
    poses: Float[ndarray, "n 4 4"],
    stored: Float[ndarray, "n 4 4"] | None,
    training_data: TrainingData,
    models: Mapping[str, Models],
) -> Float[ndarray, "n 4 4"]:
    """Return the true pose in each estimate's frame, the nearest by symmetry, NaN if unknown.

    Parameters
    ----------
    poses
        ``cam_T_est``.
    stored
        The errors ``obj_T_est`` that the outcomes state, or None.
    training_data, models
        The instances, and their dataset's name to its object models.
    """
    estimates = training_data.estimates
    out = compose(invert(poses), training_data.truth)
    if stored is not None:
        # A campaign's own error, not one derived again by another matching. Where they are the same
        # but for rounding, forests grow the same from outcomes of either kind.
        stated = invert(stored)
        same = np.abs(stated - out).max(axis=(1, 2)) < _ROUNDING
        other = np.isfinite(stated).all(axis=(1, 2)) & ~same
        out[other] = stated[other]
    return nearest_truth(out, estimates.dataset, estimates.obj_id, models)
