"""Simulated trials, each with the pose error that guided it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from os import PathLike

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.errors import MismatchError
from graspcast.estimates.outcomes import REFERENCE_GRASP, read_error_outcomes
from graspcast.forecasting.models.encoding import UNSEEN
from graspcast.forecasting.models.targets import Targets
from graspcast.io.arguments import PATH, refuse_unless, sequence

__all__ = ["SimulatedTrials"]


@dataclass(frozen=True, eq=False)
class SimulatedTrials:
    """Simulated trials of one gripper, each with the pose error that guided it.

    Attributes
    ----------
    objects
        ``dataset-number`` of each trial's object, (n,).
    obj_T_est
        Pose errors, ``inv(cam_T_true) @ cam_T_est``, metres, (n, 4, 4).
    success
        Outcomes, (n,).
    grasps
        The name of each trial's grasp, (n,); None if all are of the reference grasp.
    """

    objects: ndarray
    obj_T_est: Float[ndarray, "n 4 4"]
    success: Bool[ndarray, " n"]
    grasps: ndarray | None = None

    @property
    def names(self) -> ndarray:
        """The name of each trial's grasp, (n,)."""
        if self.grasps is None:
            return np.full(len(self), REFERENCE_GRASP)
        return self.grasps

    @property
    def pairs(self) -> set[tuple[str, str]]:
        """Objects with their grasps, of which there are trials."""
        return set(zip(self.objects.tolist(), self.names.tolist(), strict=True))

    def __repr__(self) -> str:
        return f"SimulatedTrials({len(self)} of {len(set(self.objects.tolist()))} objects)"

    def __len__(self) -> int:
        return len(self.success)

    @classmethod
    def read(cls, paths: Iterable[str | PathLike[str]], gripper: str) -> SimulatedTrials:
        """Read the trials of a gripper from one or more campaigns.

        Raises
        ------
        FormatError
            Naming the file that is wrong.
        MismatchError
            If there are none of this gripper.
        """
        paths = list(paths) if isinstance(paths, Iterable) and not isinstance(paths, str) else paths
        some = (lambda given: bool(given) and sequence(PATH)[0](given), "a list of paths")
        refuse_unless(some, paths, "SimulatedTrials.read", "paths")
        tables, errors = zip(*(read_error_outcomes(path) for path in paths), strict=True)
        table = pl.concat(tables)
        mine = (table["gripper"] == gripper).to_numpy()
        if not mine.any():
            available = ", ".join(table["gripper"].unique().sort().to_list())
            raise MismatchError(
                f"no simulated trial of the {gripper} gripper; there are trials of {available}",
                parameters=("gripper", "simulated"),
            )
        return cls(
            table["object"].to_numpy().astype(str)[mine],
            np.concatenate(errors)[mine],
            table["success"].to_numpy()[mine],
            table["grasp"].to_numpy().astype(str)[mine],
        )

    def targets(self, targets: Targets) -> Int[ndarray, " n"]:
        """Return the number of each trial's object and grasp among targets, -1 where none, (n,)."""
        out = np.full(len(self), UNSEEN, dtype=np.int64)
        names = self.names
        for grasp in np.unique(names).tolist():
            mine = names == grasp
            out[mine] = targets.numbers(self.objects[mine].tolist(), grasp)
        return out

    def select(self, which: Bool[ndarray, " n"]) -> SimulatedTrials:
        """Select trials by mask."""
        named = None if self.grasps is None else self.grasps[which]
        return replace(
            self,
            objects=self.objects[which],
            obj_T_est=self.obj_T_est[which],
            success=self.success[which],
            grasps=named,
        )
