"""Novelty detection: whether the estimators' disagreement is out of distribution.

Two checks. The first is a rank: the score of an instance is the Mahalanobis distance of its
disagreement from those in training. The disagreement holds each supporter's pose in the principal's
ray frame (independent of the object); large differences enter by their logarithm. The p-value is
the share of out-of-fold training scores that are at least as large (inductive conformal anomaly
detection). For an instance of a scene like those in training, P(p-value <= a) <= a, whatever the
distribution of the scores. Of n training instances the smallest p-value is 1 / (n + 1), so a level
of 0.01 cannot be reached with fewer than 99.

The second is a limit: a disagreement larger than any in training. It holds for any number of
training instances. A maximum of few instances is exceeded often, so with n < 2 / a it is raised by
2 / (a n), as for a distribution whose tail falls like 1 / x. Two poses more than one diameter of
the object apart do not even overlap, and are novel however many training instances are so far
apart, unless a quarter are.

Estimators that are all wrong alike agree. So the principal's own pose has limits too: its distance
from half to twice those of the middle 98 % in training, and its angle from the optical axis up to
twice theirs, or 30 degrees.

References
----------
R. Laxhammar and G. Falkman, *Conformal prediction for distribution-independent anomaly detection in
streaming vessel data*, StreamKDD 2010.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.estimates.alignment import Estimates
from graspcast.estimates.instances import scene_groups
from graspcast.forecasting.splits import fold_numbers
from graspcast.pose.ray_frame import compressed, relative
from graspcast.pose.transforms import norms

__all__ = ["OOD_ALPHA", "Disagreement", "Novelty"]

OOD_ALPHA = 0.01
"""A disagreement with this p-value or a smaller one is out of distribution: abstain."""

_QUANTITIES = (
    "{:.3g} of its distance across the viewing ray from",
    "{:.3g} of its distance along the viewing ray from",
    "{:.3g} object diameters from",
    "turned by {:.0f} degrees from",
)
"""What has a limit, in words: the columns of :func:`_sizes`."""
_ANGLE = 3
_LARGEST_SHIFT = 1.0
"""Diameters between two poses that contradict each other, even if training has a few of them."""
_MIDDLE = (0.01, 0.99)
"""Quantiles of the training poses' distances and angles; estimators have wild outliers."""
_ALWAYS_SEEN = np.radians(30.0)
"""An angle from the optical axis that most cameras see."""
_OFTEN = 0.75
"""Share of training instances below the quantile that is no contradiction, however large."""


@dataclass(frozen=True)
class Disagreement:
    """How unusual the disagreement on an instance is.

    Attributes
    ----------
    p_value
        Conformal p-value under the training data; small means novel.
    smallest
        The smallest p-value that the training data can give.
    excess
        What is larger than its limit, in words; empty if nothing is.
    """

    p_value: float
    smallest: float
    excess: str = ""

    def is_novel(self, alpha: float) -> bool | None:
        """Return whether it is out of distribution at a level; None where that cannot be told.

        A disagreement above a limit is novel at every level, also at 0, which accepts any p-value.
        """
        if self.excess or self.p_value <= alpha:
            return True
        return None if 0 < alpha < self.smallest else False


@dataclass(frozen=True, eq=False)
class Novelty:
    """A conformal novelty detector for the estimators' disagreement.

    Attributes
    ----------
    centre
        Mean disagreement in training, (6 (K - 1),).
    precision
        Inverse covariance (Ledoit-Wolf), (6 (K - 1), 6 (K - 1)).
    scores
        Out-of-fold scores of the training instances, ascending, (m,).
    limits
        Largest disagreement of each supporter with the principal that is not novel: origins across
        and along the principal's viewing ray, over the distance; origins over the object's
        diameter; rotation, radians; (K - 1, 4).
    view
        Least and largest distance of the principal's pose from the camera, metres, and largest
        angle from the optical axis, radians, that are not novel, (3,).
    """

    centre: Float[ndarray, " d"]
    precision: Float[ndarray, "d d"]
    scores: Float[ndarray, " m"]
    limits: Float[ndarray, "s 4"]
    view: Float[ndarray, "3"]

    @classmethod
    def fit(
        cls,
        estimates: Estimates,
        principal: str,
        diameter_m: Float[ndarray, " n"] | None = None,
        *,
        folds: int = 4,
    ) -> Novelty:
        """Fit to the training instances.

        Without a supporter there is no p-value: only the pose's place is bounded.

        Parameters
        ----------
        estimates
            Poses of n instances.
        principal
            The estimator with which the others are compared.
        diameter_m
            The objects' diameters, metres, NaN where unknown, (n,).
        folds
            Folds of scenes for out-of-fold scores; scenes are assigned to them in turn.
        """
        by = disagreement(estimates, principal, estimates.supporters(principal))
        if not len(by):  # nobody to disagree with: only where the pose is can be unusual
            none = np.zeros(0)
            shapes = none.reshape(0, 0), none, none.reshape(0, 4)
            return cls(none, *shapes, _usual_view(estimates.of(principal)))
        rows = _rows(by)
        fold_of = fold_numbers(scene_groups(estimates.instances), folds)
        scores = np.empty(len(rows))
        for fold in range(fold_of.max() + 1):
            test = fold_of == fold
            train = test if test.all() else ~test
            scores[test] = _distance(rows[test], *_shape(rows[train]))
        sizes = _sizes(by, estimates.of(principal), diameter_m)
        limits = np.fmax.reduce(sizes, axis=0) * max(1.0, 2 / (OOD_ALPHA * len(rows)))
        often = np.nan_to_num(np.quantile(sizes[:, :, 2], _OFTEN, axis=0), nan=0.0)
        limits[:, 2] = np.fmin(limits[:, 2], np.maximum(_LARGEST_SHIFT, often))
        view = _usual_view(estimates.of(principal))
        return cls(*_shape(rows), np.sort(scores), limits, view)

    @property
    def smallest_p_value(self) -> float:
        """The smallest p-value that :meth:`p_value` can return."""
        return 1 / (len(self.scores) + 1)

    def assess(
        self,
        estimates: Estimates,
        principal: str,
        supporters: Sequence[str],
        diameter_m: Float[ndarray, " n"] | None = None,
    ) -> list[Disagreement]:
        """Assess how unusual the disagreement on each instance is.

        Parameters
        ----------
        estimates
            Poses of n instances.
        principal, supporters
            As in training.
        diameter_m
            The objects' diameters, metres, NaN where unknown, (n,).
        """
        smallest = self.smallest_p_value
        by = disagreement(estimates, principal, supporters)
        values = self._p_value(by).tolist()
        sizes = _sizes(by, estimates.of(principal), diameter_m)
        out = [Disagreement(value, smallest) for value in values]
        above = sizes > self.limits
        for i in np.flatnonzero(above.any(axis=(1, 2))).tolist():
            # Diameters are the plainest to read, then angles.
            s, k = min(np.argwhere(above[i]).tolist(), key=lambda at: (2, 3, 1, 0).index(at[1]))
            size, limit = sizes[i, s, k], self.limits[s, k]
            if k == _ANGLE:
                size, limit = np.degrees([size, limit])
            said = f"{supporters[s]} is {_QUANTITIES[k].format(size)} {principal}"
            out[i] = Disagreement(values[i], smallest, f"{said}; the limit is {limit:.3g}")
        distance, angle = _view(estimates.of(principal))
        near, far, wide = self.view
        elsewhere = (distance < near) | (distance > far) | (angle > wide)
        for i in np.flatnonzero(elsewhere).tolist():
            said = (
                f"{principal}'s pose is {distance[i]:.2f} m away, {np.degrees(angle[i]):.0f} "
                f"degrees off the optical axis; training allows {near:.2f} to {far:.2f} m and "
                f"{np.degrees(wide):.0f} degrees"
            )
            out[i] = Disagreement(values[i], smallest, said)
        return out

    def p_value(
        self, estimates: Estimates, principal: str, supporters: Sequence[str]
    ) -> Float[ndarray, " n"]:
        """Compute the conformal p-value of each instance's disagreement; small means novel."""
        return self._p_value(disagreement(estimates, principal, supporters))

    def _p_value(self, by: Float[ndarray, "s n 6"]) -> Float[ndarray, " n"]:
        if not len(by):
            return np.full(by.shape[1], np.nan)
        score = _distance(_rows(by), self.centre, self.precision)
        at_least = len(self.scores) - np.searchsorted(self.scores, score, side="left")
        return (at_least + 1) / (len(self.scores) + 1)

    def to_arrays(self) -> dict[str, ndarray]:
        """Return everything as named arrays."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ndarray]) -> Novelty:
        """Restore what :meth:`to_arrays` returned."""
        found = cls(*(arrays[f.name] for f in fields(cls)))
        d = found.centre.size
        shapes = [getattr(found, f.name).shape for f in fields(cls)]
        if d % 6 or shapes != [(d,), (d, d), (found.scores.size,), (d // 6, 4), (3,)]:
            raise ValueError(f"the novelty detector has arrays of shapes {shapes}")
        if any(a.dtype != np.float64 or not np.isfinite(a).all() for a in arrays.values()):
            raise ValueError("the novelty detector has arrays of other than finite numbers")
        if (found.limits < 0).any() or (found.view < 0).any():
            raise ValueError("a limit of the novelty detector is not a length or an angle")
        return found


def disagreement(
    estimates: Estimates, principal: str, supporters: Sequence[str]
) -> Float[ndarray, "s n 6"]:
    """Return each supporter's pose in the principal's ray frame."""
    poses = estimates.only(principal, *supporters).cam_T_obj
    return relative(poses[0], poses[1:])


def _view(
    cam_T_obj: Float[ndarray, "n 4 4"],
) -> tuple[Float[ndarray, " n"], Float[ndarray, " n"]]:
    """Return the distance of each pose, metres, and its angle from the optical axis, radians."""
    x, y, z = cam_T_obj[:, :3, 3].T
    across = np.hypot(x, y)
    return np.hypot(across, z), np.arctan2(across, z)


def _usual_view(cam_T_obj: Float[ndarray, "n 4 4"]) -> Float[ndarray, "3"]:
    """Return the bounds of :attr:`Novelty.view` from the training poses."""
    distance, angle = _view(cam_T_obj)
    nearest, farthest = np.quantile(distance, _MIDDLE)
    widest = max(2 * np.quantile(angle, _MIDDLE[1]), _ALWAYS_SEEN)
    return np.array([nearest / 2, farthest * 2, widest])


def _rows(by: Float[ndarray, "s n 6"]) -> Float[ndarray, "n d"]:
    """Return the disagreements on each instance in one row, large values compressed."""
    return np.concatenate(compressed(by), axis=1)


def _sizes(
    by: Float[ndarray, "s n 6"],
    cam_T_obj: Float[ndarray, "n 4 4"],
    diameter_m: Float[ndarray, " n"] | None,
) -> Float[ndarray, "n s 4"]:
    """Return the magnitudes of each supporter's disagreement that :attr:`Novelty.limits` bounds."""
    distance = norms(cam_T_obj[:, :3, 3])[:, 0]
    size = np.full(len(cam_T_obj), np.nan) if diameter_m is None else diameter_m
    across, along = np.hypot(by[..., 0], by[..., 1]), np.abs(by[..., 2])
    apart = np.hypot(across, along) * distance / size
    sizes = np.stack([across, along, apart, norms(by[..., 3:])[..., 0]], axis=-1)
    return sizes.swapaxes(0, 1)


def _shape(rows: Float[ndarray, "n d"]) -> tuple[Float[ndarray, " d"], Float[ndarray, "d d"]]:
    from sklearn.covariance import LedoitWolf

    model = LedoitWolf().fit(rows)
    return model.location_, model.precision_


def _distance(
    rows: Float[ndarray, "n d"], centre: Float[ndarray, " d"], precision: Float[ndarray, "d d"]
) -> Float[ndarray, " n"]:
    away = rows - centre
    return np.asarray(np.einsum("ni,ij,nj->n", away, precision, away))
