"""Labelled trials, and stratified samples of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.pose.transforms import rotation_angle

__all__ = ["LabelledTrials", "StratifiedSample"]

_NEAR_M, _NEAR_RAD = 0.06, np.deg2rad(30.0)


@dataclass(frozen=True, eq=False)
class LabelledTrials:
    """Estimates of one object, with the observed outcomes of one gripper.

    Attributes
    ----------
    obj_T_est
        Estimates in the true object's frame, metres, (n, 4, 4).
    success
        Observed outcomes, (n,).
    """

    obj_T_est: Float[ndarray, "n 4 4"]
    success: Bool[ndarray, " n"]

    def __len__(self) -> int:
        return len(self.success)


class StratifiedSample:
    """Stratified sample of trials in a fixed order, so that a larger sample contains a smaller one.

    The strata are successes, near failures and gross failures. They get 40, 40 and 20 % of the
    sample as long as they last; the weights correct for this.

    Parameters
    ----------
    trials
        The trials to sample from.
    rng
        Random generator.
    """

    _SHARES = (0.4, 0.4, 0.2)

    def __init__(self, trials: LabelledTrials, rng: np.random.Generator):
        shift = np.linalg.norm(trials.obj_T_est[:, :3, 3], axis=1)
        turn = rotation_angle(trials.obj_T_est[:, :3, :3])
        near = (shift < _NEAR_M) & (turn < _NEAR_RAD)
        kind = np.where(trials.success, 0, np.where(near, 1, 2))
        self._rows = [rng.permutation(np.flatnonzero(kind == k)) for k in range(3)]

    def take(self, count: int) -> tuple[Int[ndarray, " m"], Float[ndarray, " m"]]:
        """Return rows of a sample and their weights; all rows if there are at most ``count``."""
        sizes = [len(rows) for rows in self._rows]
        take = np.zeros(3, dtype=int)
        while take.sum() < min(count, sum(sizes)):
            behind = [
                (take[k] + 1) / self._SHARES[k] if take[k] < sizes[k] else np.inf for k in range(3)
            ]
            take[int(np.argmin(behind))] += 1
        rows = [r[:n] for r, n in zip(self._rows, take, strict=True)]
        weights = [np.full(n, len(r) / max(n, 1)) for r, n in zip(self._rows, take, strict=True)]
        return np.concatenate(rows), np.concatenate(weights)
