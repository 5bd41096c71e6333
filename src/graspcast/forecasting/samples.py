"""Instances with known outcomes, and ways to split them.

Frames are video: a random split puts neighbours of nearly the same picture on both sides. Splits
here keep scenes apart, and cut the only scene of a dataset into contiguous blocks of frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import polars as pl
from jaxtyping import Bool, Int
from numpy import ndarray

from graspcast.errors import MismatchError, UnknownNameError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.outcomes import success_of_each

__all__ = ["Samples", "join"]


@dataclass(frozen=True)
class Samples:
    """Instances whose grasp, guided by the principal, was tried with one gripper.

    Attributes
    ----------
    estimates
        The instances' poses by all estimators.
    principal
        The estimator that guided the grasps.
    gripper
        The gripper's name.
    success
        Outcomes, (n,).
    untried
        How many instances were left out because they have no outcome.
    """

    estimates: Estimates
    principal: str
    gripper: str
    success: Bool[ndarray, "n"]
    untried: int = 0

    def __len__(self) -> int:
        return len(self.success)

    @property
    def objects(self) -> ndarray:
        """``dataset-number`` of each sample's object."""
        return self.estimates.objects

    def select(self, which: Bool[ndarray, "n"] | Int[ndarray, "m"]) -> Samples:
        """Some of the samples."""
        chosen = self.estimates.select(which)
        return Samples(chosen, self.principal, self.gripper, self.success[which], self.untried)


def _keys(estimates: Estimates) -> pl.DataFrame:
    return pl.DataFrame(
        {
            "dataset": estimates.dataset.tolist(),
            "scene_id": estimates.scene_id,
            "im_id": estimates.im_id,
            "obj_id": estimates.obj_id,
            "est_id": estimates.est_id,
        }
    )


def join(estimates: Estimates, outcomes: pl.DataFrame, principal: str, gripper: str) -> Samples:
    """Give each instance the outcome of the trial that its principal guided.

    Raises
    ------
    UnknownNameError
        For a principal or gripper that is not there.
    MismatchError
        If no instance has an outcome.
    """
    estimates.index(principal)
    grippers = outcomes["gripper"].unique().sort().to_list()
    if gripper not in grippers:
        raise UnknownNameError("gripper", gripper, grippers, hint="These have outcomes")
    success = success_of_each(estimates.instances, outcomes, principal, gripper)
    has = ~np.isnan(success)
    if not has.any():
        known = outcomes.select("estimator", "dataset").unique().sort("estimator", "dataset")
        pairs = ", ".join(f"{e} on {d}" for e, d in known.rows())
        raise MismatchError(
            f"no instance has an outcome of {principal} with the {gripper} gripper; "
            f"there are outcomes of {pairs or 'nothing'}"
        )
    return Samples(
        estimates=estimates.select(has),
        principal=principal,
        gripper=gripper,
        success=success[has] == 1,
        untried=int((~has).sum()),
    )
