"""The default forecaster: a two-stage model and a direct forest, averaged and calibrated.

The direct forest maps features and object to the success rate of similar training instances; it
cannot forecast an object without outcomes. The two-stage model
(:mod:`graspcast.forecasting.models.two_stage`) can, by simulated trials. Their average scores
better than either on scenes that are not in training (docs/evaluation.md). The log-odds of the
average are calibrated by logistic regression on out-of-fold predictions (Platt scaling).

References
----------
J. Platt, *Probabilistic Outputs for Support Vector Machines*, Advances in Large Margin Classifiers,
1999. P. Geurts, D. Ernst and L. Wehenkel, *Extremely randomized trees*, Machine Learning, 2006.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.errors import MismatchError
from graspcast.forecasting.models.base import Predictor
from graspcast.forecasting.models.calibration import expit, logit
from graspcast.forecasting.models.forest import Forest
from graspcast.forecasting.models.held_out_choice import choice_from
from graspcast.forecasting.models.out_of_fold import OutOfFold
from graspcast.forecasting.models.two_stage import (
    ERROR_INPUTS,
    ErrorModel,
    SuccessGivenError,
    expected_success,
)
from graspcast.forecasting.models.view_model import ViewModel
from graspcast.forecasting.models.visibility import Visibility

__all__ = ["Blend", "ForestSettings", "visibility_of"]

_MAX_DRAWS = 100_000


@dataclass(frozen=True)
class ForestSettings:
    """Settings of the forests.

    Attributes
    ----------
    direct
        Weight of the direct forest for objects with outcomes; 0 is the two-stage model alone, 1 the
        direct forest alone.
    trees
        Trees of each forest.
    draws
        Pose errors drawn for each forecast.
    folds
        Folds of the scenes for out-of-fold predictions, by which forecasts are calibrated; 0 for
        no calibration.
    seed
        Of everything random.
    """

    direct: float = 0.5
    trees: int = 128
    draws: int = 128
    folds: int = 4
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Blend:
    """Two-stage model and direct forest for one principal and gripper, with their calibration.

    Attributes
    ----------
    direct
        Forest from features, target (object and grasp) and guiding estimator to success, or None.
    errors, success_given_error
        The two-stage model, or None.
    estimator
        One-hot vector of the principal among all estimators, (K,).
    codes
        Code of each target (:meth:`graspcast.forecasting.models.targets.Targets.codes`), (T, C).
    tried
        Which targets have outcomes, and so are known to the direct forest, (T,).
    known
        Which targets the two-stage model knows, by outcomes or simulation, (T,).
    weight
        Of the direct forest.
    draws
        Pose errors drawn for each forecast.
    columns
        Column numbers of the error model's inputs, the ray frame's nine axes and the distance; at
        the end the number of inputs.
    calibration
        Slope and intercept on the log-odds, for the average and for the two-stage model alone,
        (2, 2).
    out_of_fold
        The out-of-fold predictions, or None without calibration.
    views
        The view model, or None; it judges by ``success_given_error`` too.
    visibility
        What one view of one estimator is forecast by, where there is no supporter, or None.
    choice
        Slope and intercept on the log-odds of the highest forecast among several grasps
        (:mod:`graspcast.forecasting.models.held_out_choice`), or None.
    """

    direct: Forest | None
    errors: ErrorModel | None
    success_given_error: SuccessGivenError | None
    estimator: Float[ndarray, " k"]
    codes: Float[ndarray, "t inputs"]
    tried: Bool[ndarray, " t"]
    known: Bool[ndarray, " t"]
    weight: float
    draws: int
    columns: Int[ndarray, " c"]
    calibration: Float[ndarray, "2 2"]
    out_of_fold: OutOfFold | None = None
    views: ViewModel | None = None
    visibility: Visibility | None = None
    choice: Float[ndarray, "2"] | None = None

    @property
    def is_calibrated(self) -> bool:
        """Whether out-of-fold predictions calibrated its forecasts."""
        views = None if self.views is None else self.views.out_of_fold
        return self.out_of_fold is not None or views is not None

    def raw(
        self, features: Float[ndarray, "n d"], numbers: Int[ndarray, " n"]
    ) -> Float[ndarray, "2 n"]:
        """Forecast without calibration: the average, and the two-stage model alone, (2, n).

        Target -1 is one of an unseen object; NaN where the two-stage model does not know it.
        """
        count = self.columns[-1]  # of the error model's inputs
        inputs, axes = self.columns[:count], self.columns[count : count + 9]
        staged = np.full(len(features), np.nan)
        if self.errors is not None and self.success_given_error is not None:
            mine = np.flatnonzero((numbers >= 0) & self.known[numbers])
            rows = features[mine]
            staged[mine] = expected_success(
                self.errors,
                self.success_given_error,
                rows[:, inputs],
                rows[:, axes].reshape(-1, 3, 3).swapaxes(1, 2),
                rows[:, self.columns[-2]],
                numbers[mine],
                draws=self.draws,
            )
        if self.direct is None:
            return np.stack([staged, staged])
        which = np.where((numbers >= 0)[:, None], self.codes[numbers], 0.0)
        guide = np.broadcast_to(self.estimator, (len(features), len(self.estimator)))
        direct = self.direct.mean(np.concatenate([features, which, guide], axis=1))
        # For objects without outcomes the direct forest is used only if there is nothing else.
        weight = np.where((numbers >= 0) & self.tried[numbers], self.weight, 0.0)
        unknown = np.isnan(staged)
        weight = np.where(unknown, 1.0, weight)
        mixed = weight * direct + (1 - weight) * np.where(unknown, 0.0, staged)
        return np.array([mixed, staged])

    def probability(
        self, features: Float[ndarray, "n d"], objects: Int[ndarray, " n"]
    ) -> Float[ndarray, " n"]:
        """Forecast the probability of success of each row.

        Raises
        ------
        MismatchError
            For an object without outcomes or simulated trials, if there is no direct forest.
        """
        if self.visibility is not None:
            return self.visibility.probability(features, objects)
        mixed, _ = self.raw(features, objects)
        if np.isnan(mixed).any():
            raise MismatchError(
                "the method two-stage cannot forecast an object without outcomes or simulated "
                "trials; train with simulated trials of the object, or with the method blend",
                parameters=("simulated", "method"),
            )
        # The two-stage model alone forecasts what it knows and the direct forest does not.
        alone = (objects >= 0) & self.known[objects] & ~self.tried[objects]
        slope, intercept = self.calibration[alone.astype(int)].T
        return expit(slope * logit(mixed) + intercept)

    def view_probability(
        self,
        statistics: Float[ndarray, "n d"],
        cam_T_fused: Float[ndarray, "n 4 4"],
        cam_T_guide: Float[ndarray, "n 4 4"],
        targets: Int[ndarray, " n"],
    ) -> Float[ndarray, " n"]:
        """Forecast the probability of success with several views (:meth:`ViewModel.raw`).

        NaN for targets that the second stage does not know.

        Raises
        ------
        MismatchError
            If it was trained without views.
        """
        if self.views is None or self.success_given_error is None:
            raise MismatchError(
                "this model was trained without views; train it with camera poses",
                parameters=("camera_poses", "model"),
            )
        out = np.full(len(statistics), np.nan)
        mine = np.flatnonzero((targets >= 0) & self.known[targets])
        if len(mine):
            raw = self.views.raw(
                self.success_given_error,
                statistics[mine],
                cam_T_fused[mine],
                cam_T_guide[mine],
                targets[mine],
                draws=self.draws,
            )
            out[mine] = self.views.calibrated(raw)
        return out

    @property
    def _parts(self) -> Bool[ndarray, " p"]:
        """Which parts there are, by which a file that lacks one is found."""
        parts = (self.direct, self.errors, self.success_given_error, self.views)
        one_view = () if self.visibility is None else (True,)
        return np.array([*(part is not None for part in parts), *one_view])

    def to_arrays(self, *, shared: bool = True) -> dict[str, ndarray]:
        """Return everything learned as named arrays; without what guides share if asked."""
        plain = ("estimator", "tried", "known", "columns", "calibration")
        out = {name: getattr(self, name) for name in plain}
        out |= {"weight": np.array(self.weight), "draws": np.array(self.draws)}
        out["parts"] = self._parts
        if not np.array_equal(self.codes, np.eye(len(self.codes))):  # not the objects alone
            out["codes"] = self.codes
        if self.choice is not None:
            out["choice"] = self.choice
        if self.out_of_fold is not None:
            out |= self.out_of_fold.to_arrays()
        if self.errors is not None:
            out |= self.errors.to_arrays("errors")
        if shared and self.direct is not None:
            out |= self.direct.to_arrays("direct")
        if shared and self.success_given_error is not None:
            out |= self.success_given_error.forest.to_arrays("success_given_error")
        if shared and self.views is not None:
            out |= self.views.to_arrays("views")
        if self.visibility is not None:
            out |= {f"visibility/{k}": v for k, v in self.visibility.to_arrays().items()}
        return out

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ndarray], shared: Blend | None = None) -> Blend:
        """Restore what :meth:`to_arrays` returned; raise a ValueError if it is no model.

        Parameters
        ----------
        arrays
            By name.
        shared
            The model of another guide, whose forests and view model are this one's too.
        """
        targets = len(arrays["tried"])
        codes = arrays.get("codes", np.eye(targets))
        if arrays["known"].shape != (targets,) or arrays["calibration"].shape != (2, 2):
            raise ValueError("the arrays of the model have different lengths")
        if codes.ndim != 2 or len(codes) != targets or not np.isfinite(codes).all():
            raise ValueError("the codes of the grasps are not finite numbers of each")
        if not 1 <= int(arrays["draws"]) <= _MAX_DRAWS:
            raise ValueError(f"the model draws {int(arrays['draws'])} pose errors")
        direct = errors = success_given_error = views = None
        if shared is not None:
            direct, success_given_error = shared.direct, shared.success_given_error
            views = shared.views
        if "errors/f/roots" in arrays:
            errors = ErrorModel.from_arrays(arrays, "errors")
        below = {
            name.removeprefix("visibility/"): array
            for name, array in arrays.items()
            if name.startswith("visibility/")
        }
        if "direct/roots" in arrays:
            direct = Forest.from_arrays(arrays, "direct")
        if "views/calibration" in arrays:
            views = ViewModel.from_arrays(arrays, "views")
        if "success_given_error/roots" in arrays:
            success_given_error = SuccessGivenError(
                Forest.from_arrays(arrays, "success_given_error"), codes
            )
            if success_given_error.forest.columns > ERROR_INPUTS + codes.shape[1]:
                raise ValueError("the model of success given error needs columns that are none")
        out = cls(
            direct,
            errors,
            success_given_error,
            arrays["estimator"],
            codes,
            arrays["tried"],
            arrays["known"],
            float(arrays["weight"]),
            int(arrays["draws"]),
            arrays["columns"],
            arrays["calibration"],
            OutOfFold.from_arrays(arrays) if "out_of_fold/image" in arrays else None,
            views,
            Visibility.from_arrays(below) if below else None,
            choice_from(arrays, "choice"),
        )
        if not np.array_equal(out._parts, arrays["parts"]):
            raise ValueError("a part of the model is missing")
        return out


def visibility_of(predictor: Predictor) -> Visibility | None:
    """Return what a predictor forecasts one view of one estimator by, or None."""
    if isinstance(predictor, Visibility):
        return predictor
    return predictor.visibility if isinstance(predictor, Blend) else None
