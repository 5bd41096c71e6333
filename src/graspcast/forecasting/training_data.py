"""What a forecaster learns from: estimates, ground truth, outcomes, and simulated errors."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from os import PathLike

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.errors import MismatchError, UnknownNameError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.outcomes import read_error_outcomes, success_of_each
from graspcast.forecasting.samples import Samples

__all__ = ["SimulatedTrials", "TrainingData", "as_training_data", "training_data"]


@dataclass(frozen=True, eq=False)
class SimulatedTrials:
    """Trials known by the error that guided them, of one gripper.

    Attributes
    ----------
    objects
        ``dataset-number`` of each trial's object, (n,).
    obj_T_est
        The errors, ``inv(cam_T_true) @ cam_T_est``, (n, 4, 4).
    success
        Outcomes, (n,).
    """

    objects: ndarray
    obj_T_est: Float[ndarray, "n 4 4"]
    success: Bool[ndarray, "n"]

    def __len__(self) -> int:
        return len(self.success)

    @classmethod
    def read(cls, paths: Iterable[str | PathLike[str]], gripper: str) -> SimulatedTrials:
        """Those of a gripper in campaigns.

        Raises
        ------
        FormatError
            Naming the file that is wrong.
        MismatchError
            If there are none of this gripper.
        """
        tables, errors = zip(*(read_error_outcomes(path) for path in paths), strict=True)
        table = pl.concat(tables)
        mine = (table["gripper"] == gripper).to_numpy()
        if not mine.any():
            has = ", ".join(table["gripper"].unique().sort().to_list())
            raise MismatchError(f"no simulated trial of the {gripper} gripper; there are of {has}")
        return cls(
            table["object"].to_numpy().astype(str)[mine],
            np.concatenate(errors)[mine],
            table["success"].to_numpy()[mine],
        )

    def select(self, which: Bool[ndarray, "n"]) -> SimulatedTrials:
        """Some of the trials."""
        return SimulatedTrials(self.objects[which], self.obj_T_est[which], self.success[which])


@dataclass(frozen=True, eq=False)
class TrainingData:
    """Instances, what is true of them, and what came of grasping them with one gripper.

    Attributes
    ----------
    estimates
        Poses by all estimators.
    principal
        The estimator whose grasps are to be forecast.
    gripper
        The gripper.
    truth
        ``cam_T_obj``, NaN where it is not known, (n, 4, 4).
    success
        What came of the grasp that each estimator guided: 1, 0, or NaN where it was not tried, (K,
        n), in the estimators' order.
    simulated
        Simulated trials by the error that guided them, of this gripper.
    """

    estimates: Estimates
    principal: str
    gripper: str
    truth: Float[ndarray, "n 4 4"]
    success: Float[ndarray, "k n"]
    simulated: SimulatedTrials | None = None

    def __len__(self) -> int:
        return len(self.estimates)

    @property
    def has_truth(self) -> Bool[ndarray, "n"]:
        """Which instances' true poses are known."""
        return np.isfinite(self.truth).all(axis=(1, 2))

    @property
    def samples(self) -> Samples:
        """The instances that were tried with the principal's estimate.

        Raises
        ------
        MismatchError
            If there are none.
        """
        mine = self.success[self.estimates.index(self.principal)]
        has = ~np.isnan(mine)
        if not has.any():
            raise MismatchError(
                f"no instance has an outcome of {self.principal} with the {self.gripper} gripper"
            )
        return Samples(
            self.estimates.select(has),
            self.principal,
            self.gripper,
            mine[has] == 1,
            int((~has).sum()),
        )

    def select(self, which: Bool[ndarray, "n"] | Int[ndarray, "m"]) -> TrainingData:
        """Some of the instances, with all simulated trials."""
        return replace(
            self,
            estimates=self.estimates.select(which),
            truth=self.truth[which],
            success=self.success[:, which],
        )

    def only(self, *estimators: str) -> TrainingData:
        """What would be known had there been only these estimators: their poses and outcomes.

        Raises
        ------
        UnknownNameError
            For one that is not there.
        MismatchError
            If the principal is not among them.
        """
        if self.principal not in estimators:
            raise MismatchError(
                f"{self.principal} is the principal, but not among {', '.join(estimators)}"
            )
        rows = [self.estimates.index(name) for name in estimators]
        return replace(self, estimates=self.estimates.only(*estimators), success=self.success[rows])


def training_data(
    estimates: Estimates,
    outcomes: pl.DataFrame | None,
    principal: str,
    gripper: str,
    *,
    truth: Float[ndarray, "n 4 4"] | None = None,
    simulated: SimulatedTrials | None = None,
) -> TrainingData:
    """Put together what is known of some instances.

    Parameters
    ----------
    estimates
        Poses by K estimators.
    outcomes
        As :func:`graspcast.estimates.outcomes.read_outcomes` returns them, or None.
    principal
        Whose grasps are to be forecast.
    gripper
        The gripper.
    truth
        ``cam_T_obj``, NaN where unknown; from :func:`~graspcast.estimates.matching.true_poses`.
    simulated
        Simulated trials of the gripper.

    Raises
    ------
    UnknownNameError
        For a principal or gripper that is not there.
    """
    estimates.index(principal)
    success = np.full((len(estimates.estimators), len(estimates)), np.nan)
    if outcomes is not None:
        grippers = outcomes["gripper"].unique().sort().to_list()
        if gripper not in grippers:
            raise UnknownNameError("gripper", gripper, grippers, hint="These have outcomes")
        # Detections of several instances are numbered by the principal's scores; the same number
        # may mean another instance in the outcomes of another estimator.
        image = ["dataset", "scene_id", "im_id", "obj_id"]
        alone = outcomes.filter(pl.col("est_id").fill_null(0).max().over(image) == 0)
        for k, name in enumerate(estimates.estimators):
            table = outcomes if name == principal else alone
            success[k] = success_of_each(estimates.instances, table, name, gripper)
    if truth is None:
        truth = np.full((len(estimates), 4, 4), np.nan)
    return TrainingData(estimates, principal, gripper, truth, success, simulated)


def as_training_data(given: Samples | TrainingData) -> TrainingData:
    """Samples as lessons without ground truth, of the principal's outcomes alone."""
    if isinstance(given, TrainingData):
        return given
    estimates = given.estimates
    success = np.full((len(estimates.estimators), len(estimates)), np.nan)
    success[estimates.index(given.principal)] = given.success
    truth = np.full((len(estimates), 4, 4), np.nan)
    return TrainingData(estimates, given.principal, given.gripper, truth, success)
