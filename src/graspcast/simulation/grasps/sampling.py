"""Trials with known outcomes, and samples of them that say much with few trials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.pose.transforms import rotation_angle

__all__ = ["FittedTrials", "StratifiedSample"]

_NEAR_M, _NEAR_RAD = 0.06, np.deg2rad(30.0)


@dataclass(frozen=True, eq=False)
class FittedTrials:
    """Estimates of one object and the outcomes that one gripper is said to have had.

    Attributes
    ----------
    obj_T_est
        The estimates seen from the true object, metres, (n, 4, 4).
    success
        Given outcomes, (n,).
    """

    obj_T_est: Float[ndarray, "n 4 4"]
    success: Bool[ndarray, " n"]

    def __len__(self) -> int:
        return len(self.success)


class StratifiedSample:
    """Trials in a fixed order, so that more trials include the fewer ones.

    Of successes, near failures and gross failures 40, 40 and 20 % are taken while there are any;
    the weights make up for it.
    """

    _SHARES = (0.4, 0.4, 0.2)

    def __init__(self, trials: FittedTrials, rng: np.random.Generator):
        shift = np.linalg.norm(trials.obj_T_est[:, :3, 3], axis=1)
        turn = rotation_angle(trials.obj_T_est[:, :3, :3])
        near = (shift < _NEAR_M) & (turn < _NEAR_RAD)
        kind = np.where(trials.success, 0, np.where(near, 1, 2))
        self._rows = [rng.permutation(np.flatnonzero(kind == k)) for k in range(3)]

    def take(self, count: int) -> tuple[Int[ndarray, " m"], Float[ndarray, " m"]]:
        """Rows and what each stands for; all rows if there are fewer than ``count``."""
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
