"""Trials whose outcome is known from elsewhere, each in its part of the images."""

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
from graspcast.estimates.image_split import Part, frames_of, part_of
from graspcast.estimates.outcomes import join_outcomes
from graspcast.simulation.campaign.from_estimates import trials_from_estimates
from graspcast.simulation.campaign.requests import TrialRequests
from graspcast.simulation.grasps.sampling import FittedTrials

__all__ = ["ObservedTrials", "observed_trials"]


@dataclass(frozen=True, eq=False)
class ObservedTrials:
    """Trials with given outcomes.

    Attributes
    ----------
    requests
        The trials.
    success
        Their given outcomes, (n,).
    part
        The part of the images that each belongs to, as text, (n,).
    """

    requests: TrialRequests
    success: Bool[ndarray, " n"]
    part: ndarray

    def of(self, name: str, gripper: str, part: Part) -> FittedTrials:
        """The trials of one object and gripper in one part of the images.

        Raises
        ------
        UnknownNameError
            If there are none of this object with this gripper.
        """
        pairs = self.requests.pairs()
        if (name, gripper) not in pairs:
            known = [f"{o} by {g}" for o, g in pairs]
            raise UnknownNameError("trials of", f"{name} by {gripper}", known)
        rows = self.requests.rows_of((name, gripper))
        rows = rows[self.part[rows] == part]
        return FittedTrials(self.requests.obj_T_est[rows], self.success[rows])


def observed_trials(
    results: Mapping[str, Mapping[str, Results]],
    datasets: Mapping[str, BopDataset],
    outcomes: pl.DataFrame,
) -> ObservedTrials:
    """Join estimates, ground truth and given outcomes.

    Parameters
    ----------
    results
        Dataset's name to estimator's name to results.
    datasets
        Dataset's name to its BOP directory, with ground truth.
    outcomes
        As :func:`graspcast.estimates.outcomes.read_outcomes` returns them.

    Raises
    ------
    InputError
        If no estimate has a given outcome.
    """
    grippers = outcomes["gripper"].unique().sort().to_list()
    asked = trials_from_estimates(results, datasets, grippers)
    joined = join_outcomes(asked.keys.with_row_index("row"), outcomes).drop_nulls("success")
    if not len(joined):
        raise InputError("none of these estimates has an outcome; are names and numbers the same?")
    requests = asked.select(joined["row"].to_numpy().astype(np.int64))
    keys = requests.keys
    frames = frames_of({name: dataset.ground_truth for name, dataset in datasets.items()})
    return ObservedTrials(
        requests=requests,
        success=joined["success"].to_numpy().astype(bool),
        part=part_of(
            keys["dataset"].to_numpy(),
            keys["scene_id"].to_numpy(),
            keys["im_id"].to_numpy(),
            frames,
        ),
    )
