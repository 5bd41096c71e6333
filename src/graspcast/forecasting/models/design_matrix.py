"""The design matrix: training data as arrays of numbers, from which forests are grown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.estimates.instances import scene_groups
from graspcast.estimates.matching import nearest_truth
from graspcast.forecasting.features import consensus_features
from graspcast.forecasting.models.encoding import UNSEEN
from graspcast.forecasting.training_data import TrainingData
from graspcast.pose.ray_frame import relative
from graspcast.pose.transforms import compose, invert

__all__ = ["DesignMatrix"]

_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class DesignMatrix:
    """Training data as arrays: features, outcomes and pose errors for each guiding estimator.

    Attributes
    ----------
    principal
        Number of the principal among the K estimators.
    names
        Names of the principal's features.
    features
        The set ``full`` with each estimator in turn as the principal, (K, n, d).
    success
        1, 0, or NaN, (K, n).
    truth
        True pose in each estimate's ray frame (:func:`graspcast.pose.ray_frame.relative`), NaN
        where unknown, (K, n, 6).
    obj_T_est
        Pose errors, up to the object's symmetries, (K, n, 4, 4).
    numbers
        Each instance's object number, -1 for one that is not among the objects, (n,).
    groups
        Each instance's scene (or block of frames), (n,).
    objects
        Number of objects.
    simulated
        Pose errors, object numbers and outcomes of simulated trials of these objects.
    """

    principal: int
    names: tuple[str, ...]
    features: Float[ndarray, "k n d"]
    success: Float[ndarray, "k n"]
    truth: Float[ndarray, "k n 6"]
    obj_T_est: Float[ndarray, "k n 4 4"]
    numbers: Int[ndarray, " n"]
    groups: ndarray
    objects: int
    simulated: tuple[ndarray, ndarray, ndarray] | None

    @property
    def own(self) -> Float[ndarray, "n d"]:
        """The principal's features."""
        return self.features[self.principal]

    @property
    def is_tried(self) -> Bool[ndarray, " n"]:
        """Which instances have an outcome of a grasp that the principal guided."""
        return ~np.isnan(self.success[self.principal])

    @classmethod
    def of(
        cls, training_data: TrainingData, objects: Sequence[str], models: Mapping[str, Models]
    ) -> DesignMatrix:
        """Compute the arrays once, for all forests that are grown from parts of them."""
        estimates = training_data.estimates
        number = {name: i for i, name in enumerate(objects)}
        # Instances of other objects still train the error model.
        numbers = np.array(
            [number.get(name, UNSEEN) for name in estimates.objects.tolist()], dtype=np.int64
        )
        names: tuple[str, ...] = ()
        features, truths, errors = [], [], []
        stored = training_data.obj_T_est
        for k, name in enumerate(estimates.estimators):
            found = consensus_features(estimates, name, which="full", models=models)
            names = found.names if name == training_data.principal else names
            features.append(found.values)
            poses = estimates.of(name)
            est_T_true = compose(invert(poses), training_data.truth)
            if stored is not None:
                # A campaign's own error, not one derived again by another matching. Where they are
                # the same but for rounding, forests grow the same from outcomes of either kind.
                stated = invert(stored[k])
                same = np.abs(stated - est_T_true).max(axis=(1, 2)) < _ROUNDING
                other = np.isfinite(stated).all(axis=(1, 2)) & ~same
                est_T_true[other] = stated[other]
            est_T_true = nearest_truth(est_T_true, estimates.dataset, estimates.obj_id, models)
            known = np.isfinite(est_T_true).all(axis=(1, 2))
            near = compose(poses, est_T_true)
            truths.append(np.full((len(near), 6), np.nan))
            truths[-1][known] = relative(poses[known], near[known])
            errors.append(invert(est_T_true))
        simulated = None
        if training_data.simulated is not None:
            mine = np.isin(training_data.simulated.objects, list(number))
            trials = training_data.simulated.select(mine)
            simulated = (
                trials.obj_T_est,
                np.array([number[name] for name in trials.objects.tolist()], dtype=np.int64),
                trials.success,
            )
        return cls(
            estimates.index(training_data.principal),
            names,
            np.stack(features),
            training_data.success,
            np.stack(truths),
            np.stack(errors),
            numbers,
            scene_groups(estimates.instances),
            len(objects),
            simulated,
        )
