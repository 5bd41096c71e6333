"""The view model: success of a grasp, given a pose fused from several views.

The error model draws the true pose around the fused pose, from the statistics of the fusion
(:mod:`graspcast.views.statistics`). Success given error, the same forest that judges single views,
then judges the pose that guides: the fused one, or any estimator's. So one model answers for any
number of views, any estimator that guides, and a single estimator.

Whether a fusion is out of distribution is a conformal p-value: the rank of its largest residual
statistic, in units of the training instances' spread, among theirs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.forecasting.models.calibration import calibrated
from graspcast.forecasting.models.held_out_choice import choice_from
from graspcast.forecasting.models.out_of_fold import OutOfFold
from graspcast.forecasting.models.two_stage import (
    ErrorModel,
    SuccessGivenError,
    expected_success,
)
from graspcast.forecasting.novelty import OOD_ALPHA, Disagreement
from graspcast.pose.ray_frame import obj_R_ray
from graspcast.pose.transforms import compose, invert, norms
from graspcast.views.statistics import RESIDUALS, STATISTICS

__all__ = ["ViewModel"]

_MIDDLE, _UPPER = 0.5, 0.9


@dataclass(frozen=True, eq=False)
class ViewModel:
    """Distribution of the true pose around a fused pose, with calibration and novelty.

    Attributes
    ----------
    errors
        The error model; its inputs are the statistics of the fusion.
    calibration
        Slope and intercept on the log-odds of the forecasts, (2,).
    centre, scale
        Medians and spreads of the residual statistics in training, (r,).
    scores
        Novelty scores of the training instances, ascending, (m,).
    out_of_fold
        Out-of-fold predictions with the outcomes of single-view guides, or None.
    choice
        As of :class:`graspcast.forecasting.models.blend.Blend`.
    """

    errors: ErrorModel
    calibration: Float[ndarray, "2"]
    centre: Float[ndarray, " r"]
    scale: Float[ndarray, " r"]
    scores: Float[ndarray, " m"]
    out_of_fold: OutOfFold | None = None
    choice: Float[ndarray, "2"] | None = None

    @classmethod
    def fit(
        cls,
        statistics: Float[ndarray, "m d"],
        truth: Float[ndarray, "m 6"],
        instance: Int[ndarray, " m"],
        views: Int[ndarray, " m"],
        *,
        trees: int,
        seed: int,
    ) -> ViewModel:
        """Fit on fused poses whose true pose is known, without calibration.

        Parameters
        ----------
        statistics
            Of the fusions.
        truth
            True poses in the fused poses' ray frames.
        instance
            Of which training instance each is.
        views
            From how many views; one fusion of each instance from several counts for novelty.
        trees, seed
            Of the error model.
        """
        errors = ErrorModel.fit(statistics, truth, trees=trees, seed=seed)
        several = views > 1
        residuals, instance = statistics[several][:, RESIDUALS], instance[several]
        centre = np.quantile(residuals, _MIDDLE, axis=0)
        scale = np.maximum(np.quantile(residuals, _UPPER, axis=0) - centre, 1e-3)
        _, last = np.unique(instance[::-1], return_index=True)
        one = residuals[::-1][last]
        scores = np.sort(((one - centre) / scale).max(axis=1))
        return cls(errors, np.array([1.0, 0.0]), centre, scale, scores)

    def raw(
        self,
        success_given_error: SuccessGivenError,
        statistics: Float[ndarray, "n d"],
        cam_T_fused: Float[ndarray, "n 4 4"],
        cam_T_guide: Float[ndarray, "n 4 4"],
        numbers: Int[ndarray, " n"],
        *,
        draws: int,
    ) -> Float[ndarray, " n"]:
        """Forecast success without calibration.

        Parameters
        ----------
        success_given_error
            The second stage.
        statistics
            Of the fusions.
        cam_T_fused
            Fused poses, of equivalent ones by symmetry those nearest to the guiding poses.
        cam_T_guide
            The poses that guide.
        numbers
            Targets of the second stage.
        draws
            Pose errors drawn for each forecast.
        """
        return expected_success(
            self.errors,
            success_given_error,
            statistics,
            obj_R_ray(cam_T_fused),
            norms(cam_T_fused[:, :3, 3])[:, 0],
            numbers,
            est_T_guide=compose(invert(cam_T_fused), cam_T_guide),
            draws=draws,
        )

    def calibrated(self, raw: Float[ndarray, " n"]) -> Float[ndarray, " n"]:
        """Return the probabilities of raw forecasts."""
        return calibrated(raw, self.calibration)

    def assess(self, statistics: Float[ndarray, "n d"]) -> list[Disagreement]:
        """Assess how unusual the residuals of each fusion are."""
        count = len(self.scores)
        score = ((statistics[:, RESIDUALS] - self.centre) / self.scale).max(axis=1)
        at_least = count - np.searchsorted(self.scores, score, side="left")
        smallest = 1 / (count + 1)
        # As in the novelty of disagreements: a maximum of few is exceeded often.
        limit = self.scores[-1] * max(1.0, 2 / (OOD_ALPHA * count))
        said = "the estimates of the views differ more than in training"
        return [
            Disagreement((n + 1) / (count + 1), smallest, said if s > limit else "")
            for n, s in zip(at_least.tolist(), score.tolist(), strict=True)
        ]

    def to_arrays(self, prefix: str) -> dict[str, ndarray]:
        """Return everything learned as named arrays."""
        out = {f"{prefix}/{name}": getattr(self, name) for name in _PLAIN}
        out |= self.errors.to_arrays(f"{prefix}/errors")
        if self.choice is not None:
            out[f"{prefix}/choice"] = self.choice
        if self.out_of_fold is not None:
            out |= {f"{prefix}/{k}": v for k, v in self.out_of_fold.to_arrays().items()}
        return out

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ndarray], prefix: str) -> ViewModel:
        """Restore what :meth:`to_arrays` returned.

        Raises
        ------
        ValueError
            If the arrays are no view model.
        """
        errors = ErrorModel.from_arrays(arrays, f"{prefix}/errors")
        plain = [arrays[f"{prefix}/{name}"] for name in _PLAIN]
        shapes = [(2,), (len(RESIDUALS),), (len(RESIDUALS),)]
        wrong = [part.shape for part in plain[:3]] != shapes or plain[3].ndim != 1
        if wrong or not len(plain[3]) or errors.forest.columns > len(STATISTICS):
            raise ValueError("the arrays of a view model have wrong shapes")
        if any(p.dtype != np.float64 or not np.isfinite(p).all() for p in plain):
            raise ValueError("a view model holds other than finite numbers")
        if (plain[2] <= 0).any() or (np.diff(plain[3]) < 0).any():
            raise ValueError("the scales or scores of a view model are wrong")
        below = {
            name.removeprefix(f"{prefix}/"): array
            for name, array in arrays.items()
            if name.startswith(f"{prefix}/out_of_fold/")
        }
        calibration, centre, scale, scores = plain
        kept = OutOfFold.from_arrays(below) if below else None
        choice = choice_from(arrays, f"{prefix}/choice")
        return cls(errors, calibration, centre, scale, scores, kept, choice)


_PLAIN = ("calibration", "centre", "scale", "scores")
