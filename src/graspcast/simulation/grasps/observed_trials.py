"""Trials with observed outcomes, split into train, validation and test."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import polars as pl
from jaxtyping import Bool
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results
from graspcast.errors import InputError, UnknownNameError
from graspcast.estimates.image_split import Split, frames_of, split_of
from graspcast.estimates.outcomes import REFERENCE_GRASP, join_outcomes
from graspcast.simulation.campaign.from_estimates import trials_from_estimates
from graspcast.simulation.campaign.requests import TrialRequests
from graspcast.simulation.grasps.sampling import LabelledTrials

__all__ = ["ObservedTrials", "observed_trials"]


@dataclass(frozen=True, eq=False)
class ObservedTrials:
    """Trials with observed outcomes.

    Attributes
    ----------
    requests
        The trials.
    success
        Observed outcomes, (n,).
    split
        Split of each trial (``train``, ``validation`` or ``test``), (n,).
    """

    requests: TrialRequests
    success: Bool[ndarray, " n"]
    split: ndarray

    def of(self, name: str, gripper: str, split: Split) -> LabelledTrials:
        """Return the trials of one object and gripper in one split.

        Raises
        ------
        UnknownNameError
            If there are none of this object with this gripper.
        """
        setups = self.requests.setups()
        if (name, gripper, REFERENCE_GRASP) not in setups:
            known = [f"{o} by {g}" for o, g, _ in setups]
            raise UnknownNameError("trials of", f"{name} by {gripper}", known)
        rows = self.requests.rows_of(name, gripper, REFERENCE_GRASP)
        rows = rows[self.split[rows] == split]
        return LabelledTrials(self.requests.obj_T_est[rows], self.success[rows])


def observed_trials(
    results: Mapping[str, Mapping[str, Results]],
    datasets: Mapping[str, BopDataset],
    outcomes: pl.DataFrame,
) -> ObservedTrials:
    """Join estimates, ground truth and observed outcomes.

    Parameters
    ----------
    results
        Dataset's name to estimator's name to results.
    datasets
        Dataset's name to its BOP directory, with ground truth.
    outcomes
        From :func:`graspcast.estimates.outcomes.read_outcomes`.

    Raises
    ------
    InputError
        If no estimate has an outcome.
    """
    grippers = outcomes["gripper"].unique().sort().to_list()
    asked = trials_from_estimates(results, datasets, grippers)
    joined = join_outcomes(asked.keys.with_row_index("row"), outcomes).drop_nulls("success")
    if not len(joined):
        raise InputError(
            "no estimate has an outcome; check that estimators and instances have the same names",
            parameters=("estimates", "outcomes"),
        )
    requests = asked.select(joined["row"].to_numpy().astype(np.int64))
    keys = requests.keys
    frames = frames_of({name: dataset.ground_truth for name, dataset in datasets.items()})
    return ObservedTrials(
        requests=requests,
        success=joined["success"].to_numpy().astype(bool),
        split=split_of(
            keys["dataset"].to_numpy(),
            keys["scene_id"].to_numpy(),
            keys["im_id"].to_numpy(),
            frames,
        ),
    )
