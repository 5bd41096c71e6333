"""Outcomes of estimators that are learned from, but not needed at run time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.alignment import Estimates
from graspcast.forecasting.pose_checks import refuse_most

__all__ = ["LearnedOutcomes", "check_names"]


@dataclass(frozen=True, eq=False)
class LearnedOutcomes:
    """Grasps of the training instances that L further estimators guided.

    Success given error, and with views the calibration, are learned from them as well; nothing else
    is.

    Attributes
    ----------
    estimators
        Their names, sorted.
    cam_T_obj
        Their poses, metres, NaN where one has none of an instance, (L, n, 4, 4).
    success
        Outcomes of the grasps that each guided: 1, 0, or NaN where not tried, (L, n).
    obj_T_est
        The error that guided each of these grasps where the outcomes state it, NaN elsewhere,
        (L, n, 4, 4), or None.
    """

    estimators: tuple[str, ...]
    cam_T_obj: Float[ndarray, "l n 4 4"]
    success: Float[ndarray, "l n"]
    obj_T_est: Float[ndarray, "l n 4 4"] | None = None

    def select(self, which: Bool[ndarray, " n"] | Int[ndarray, " m"]) -> LearnedOutcomes:
        """Select instances by mask or number."""
        return LearnedOutcomes(
            self.estimators,
            self.cam_T_obj[:, which],
            self.success[:, which],
            None if self.obj_T_est is None else self.obj_T_est[:, which],
        )

    def joined(self, other: LearnedOutcomes) -> LearnedOutcomes:
        """Add the outcomes of further estimators, sorted by name."""
        names = (*self.estimators, *other.estimators)
        order = np.argsort(names)
        stated = [
            np.full((*part.success.shape, 4, 4), np.nan) if part.obj_T_est is None
            else part.obj_T_est
            for part in (self, other)
        ]  # fmt: skip
        return LearnedOutcomes(
            tuple(sorted(names)),
            np.concatenate([self.cam_T_obj, other.cam_T_obj])[order],
            np.concatenate([self.success, other.success])[order],
            np.concatenate(stated)[order],
        )

    def usable(self, truth: Float[ndarray, "n 4 4"]) -> Bool[ndarray, "l n"]:
        """Find the outcomes of grasps whose pose error is known: stated, or by the true pose.

        Parameters
        ----------
        truth
            True poses ``cam_T_obj`` of the instances, NaN where unknown.
        """
        has_pose = np.isfinite(self.cam_T_obj).all(axis=(2, 3))
        has_error = has_pose & np.isfinite(truth).all(axis=(1, 2))
        if self.obj_T_est is not None:
            has_error |= np.isfinite(self.obj_T_est).all(axis=(2, 3))
        return ~np.isnan(self.success) & has_error

    def counts(self, truth: Float[ndarray, "n 4 4"]) -> dict[str, int]:
        """Return each estimator's number of :meth:`usable` outcomes."""
        return dict(zip(self.estimators, self.usable(truth).sum(axis=1).tolist(), strict=True))

    def refuse_most(self, estimates: Estimates, models: Mapping[str, Models] | None) -> None:
        """Raise if one of the estimators has no sane pose of one instance in ten, or more.

        Raises
        ------
        InputError
            As :func:`graspcast.forecasting.pose_checks.refuse_most`.
        """
        for name, poses in zip(self.estimators, self.cam_T_obj, strict=True):
            mine = replace(estimates, estimators=(name,), cam_T_obj=poses[None], seen={})
            refuse_most(mine.select(np.isfinite(poses).all(axis=(1, 2))), models)

    def check(self, truth: Float[ndarray, "n 4 4"], gripper: str) -> None:
        """Raise if there is nothing to learn from one of the estimators.

        Raises
        ------
        MismatchError
            If none of the instances has an outcome of its grasps.
        InputError
            If none of these grasps has a known pose error.
        """
        for name, success in zip(self.estimators, self.success, strict=True):
            tried = int((~np.isnan(success)).sum())
            if not tried:
                raise MismatchError(
                    f"nothing can be learned from {name}: no instance has an outcome of a grasp "
                    f"that it guided with the {gripper} gripper",
                    parameters=("learn_from", "outcomes"),
                )
            if not self.counts(truth)[name]:
                raise InputError(
                    f"nothing can be learned from {name}: success given error takes the pose error "
                    f"of each grasp, and the true pose is known of none of the {tried} instances "
                    f"with an outcome of {name}",
                    parameters=("learn_from", "ground_truth", "bop"),
                )


def check_names(names: Sequence[str], principal: str, known: Sequence[str]) -> None:
    """Raise unless estimators can be those that are only learned from.

    Parameters
    ----------
    names
        The estimators.
    principal
        The estimator whose grasps are to be forecast.
    known
        Those with estimates.

    Raises
    ------
    InputError
        If the principal is among them.
    UnknownNameError
        For one without estimates.
    """
    if principal in names:
        raise InputError(
            f"{principal} is the principal, from whose outcomes is learned in any case, and whose "
            "estimates are needed at run time; name others to learn from",
            parameters=("learn_from", "principal"),
        )
    for name in names:
        if name not in known:
            raise UnknownNameError("estimator", name, known, parameters=("learn_from",))
