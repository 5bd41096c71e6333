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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.instances import unit_names
from graspcast.forecasting.models.calibration import expit, fit_calibration, logit
from graspcast.forecasting.models.design_matrix import DesignMatrix
from graspcast.forecasting.models.encoding import one_hot_numbers
from graspcast.forecasting.models.forest import Forest, flatten
from graspcast.forecasting.models.out_of_fold import OutOfFold
from graspcast.forecasting.models.two_stage import (
    ERROR_INPUTS,
    ErrorModel,
    SuccessGivenError,
    expected_success,
)
from graspcast.forecasting.splits import fold_numbers
from graspcast.forecasting.training_data import TrainingData
from graspcast.io.progress import Progress, step_of

__all__ = ["Blend", "ForestSettings"]

_MAX_DRAWS = 100_000

_STAGE_INPUTS = (
    "shift", "turn", "mid", "across_rel", "angle", "angle_between", "offset_between",
    "ray_between", "distance",
)  # fmt: skip
"""Name stems of the features that are inputs of the error model. Features that depend on the object
or on the viewing direction are left out, which generalises better to new scenes."""


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
        Forest from features, object and guiding estimator to success, or None.
    errors, success_given_error
        The two-stage model, or None.
    estimator
        One-hot vector of the principal among all estimators, (K,).
    tried
        Which objects have outcomes, and so are known to the direct forest, (objects,).
    known
        Which objects the two-stage model knows, by outcomes or simulation, (objects,).
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
    """

    direct: Forest | None
    errors: ErrorModel | None
    success_given_error: SuccessGivenError | None
    estimator: Float[ndarray, " k"]
    tried: Bool[ndarray, " o"]
    known: Bool[ndarray, " o"]
    weight: float
    draws: int
    columns: Int[ndarray, " c"]
    calibration: Float[ndarray, "2 2"]
    out_of_fold: OutOfFold | None = None

    @classmethod
    def fit(
        cls,
        training_data: TrainingData,
        objects: Sequence[str],
        models: Mapping[str, Models],
        settings: ForestSettings,
        *,
        progress: Progress | None = None,
    ) -> Blend:
        """Train on these objects, and calibrate by out-of-fold predictions.

        Raises
        ------
        InputError
            If there is neither ground truth for the two-stage model nor outcomes for the direct
            forest.
        """
        matrix = DesignMatrix.of(training_data, objects, models)
        folds = min(settings.folds, len(np.unique(matrix.groups)))
        blend = _grow(matrix, np.full(len(training_data), True), settings)
        step_of(progress, 0, folds + 1)(1.0, "growing forests")
        if folds < 2 or not blend.tried.any():
            return blend
        predictions = _out_of_fold(matrix, settings, folds, progress)
        own = matrix.success[matrix.principal]
        calibration = np.stack([fit_calibration(each, own) for each in predictions])
        rows = np.flatnonzero(~np.isnan(predictions[0]))
        if not len(rows):
            return blend
        slope, intercept = calibration[0]
        out_of_fold = OutOfFold(
            expit(slope * logit(predictions[0, rows]) + intercept),
            own[rows] == 1,
            unit_names(training_data.estimates.select(rows).instances, "image"),
        )
        return replace(blend, calibration=calibration, out_of_fold=out_of_fold)

    def raw(
        self, features: Float[ndarray, "n d"], numbers: Int[ndarray, " n"]
    ) -> Float[ndarray, "2 n"]:
        """Forecast without calibration: the average, and the two-stage model alone, (2, n).

        Object number -1 is an unseen object; NaN where the two-stage model does not know it.
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
        which = one_hot_numbers(numbers, len(self.tried))
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

    def to_arrays(self) -> dict[str, ndarray]:
        """Return everything learned as named arrays."""
        plain = ("estimator", "tried", "known", "columns", "calibration")
        out = {name: getattr(self, name) for name in plain}
        out |= {"weight": np.array(self.weight), "draws": np.array(self.draws)}
        if self.out_of_fold is not None:
            out |= self.out_of_fold.to_arrays()
        if self.direct is not None:
            out |= self.direct.to_arrays("direct")
        if self.errors is not None and self.success_given_error is not None:
            out |= self.errors.to_arrays("errors") | self.success_given_error.forest.to_arrays(
                "success_given_error"
            )
        return out

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ndarray]) -> Blend:
        """Restore what :meth:`to_arrays` returned; raise a ValueError if it is no model."""
        objects = len(arrays["tried"])
        if arrays["known"].shape != (objects,) or arrays["calibration"].shape != (2, 2):
            raise ValueError("the arrays of the model have different lengths")
        if not 1 <= int(arrays["draws"]) <= _MAX_DRAWS:
            raise ValueError(f"the model draws {int(arrays['draws'])} pose errors")
        direct = errors = success_given_error = None
        if "direct/roots" in arrays:
            direct = Forest.from_arrays(arrays, "direct")
        if "success_given_error/roots" in arrays:
            errors = ErrorModel.from_arrays(arrays, "errors")
            success_given_error = SuccessGivenError(
                Forest.from_arrays(arrays, "success_given_error"), objects
            )
            if success_given_error.forest.columns > ERROR_INPUTS + objects:
                raise ValueError("the model of success given error needs columns that are none")
        return cls(
            direct,
            errors,
            success_given_error,
            arrays["estimator"],
            arrays["tried"],
            arrays["known"],
            float(arrays["weight"]),
            int(arrays["draws"]),
            arrays["columns"],
            arrays["calibration"],
            OutOfFold.from_arrays(arrays) if "out_of_fold/image" in arrays else None,
        )


def _out_of_fold(
    matrix: DesignMatrix, settings: ForestSettings, folds: int, progress: Progress | None
) -> Float[ndarray, "2 n"]:
    """Forecast each tried instance by forests grown without its scene; NaN for all others."""
    fold_of = fold_numbers(matrix.groups, folds, seed=settings.seed)
    inner = replace(settings, trees=max(32, settings.trees // 2))
    predictions = np.full((2, len(fold_of)), np.nan)
    for fold in range(folds):
        try:
            forest = _grow(matrix, fold_of != fold, inner)
        except InputError:  # all outcomes are in this fold, or all others are equal
            continue
        rows = np.flatnonzero((fold_of == fold) & matrix.is_tried)
        rows = rows[forest.tried[matrix.numbers[rows]]]
        predictions[:, rows] = forest.raw(matrix.own[rows], matrix.numbers[rows])
        step_of(progress, fold + 1, folds + 1)(1.0, "growing forests")
    return predictions


def _grow(matrix: DesignMatrix, rows: Bool[ndarray, " n"], settings: ForestSettings) -> Blend:
    """Grow the forests from some of the instances, without calibration."""
    guide, instance = np.nonzero(~np.isnan(matrix.success) & rows)
    tried = np.bincount(matrix.numbers[instance], minlength=matrix.objects) > 0
    columns = _columns(matrix.names)
    direct = errors = success_given_error = None
    known = np.zeros(matrix.objects, dtype=bool)
    if settings.direct > 0:
        direct = _grow_direct(matrix, guide, instance, settings)
    annotated = rows & np.isfinite(matrix.truth[matrix.principal]).all(axis=1)
    if settings.direct < 1 and annotated.any():
        poses, numbers, success = _trials(matrix, guide, instance, tried)
        known = np.bincount(numbers, minlength=matrix.objects) > 0
        if known.any():
            forest = {"trees": settings.trees, "seed": settings.seed}
            inputs = matrix.own[annotated][:, columns[: columns[-1]]]
            errors = ErrorModel.fit(inputs, matrix.truth[matrix.principal][annotated], **forest)
            success_given_error = SuccessGivenError.fit(
                poses, numbers, success, objects=matrix.objects, **forest
            )
    if direct is None and success_given_error is None:
        raise InputError(
            "there is nothing to learn from: the two-stage model needs ground truth and outcomes "
            "or simulated trials, the direct forest needs outcomes",
            parameters=("outcomes", "ground_truth", "bop", "simulated"),
        )
    estimator = np.eye(len(matrix.success))[matrix.principal]
    identity = np.array([[1.0, 0.0], [1.0, 0.0]])
    return Blend(
        direct,
        errors,
        success_given_error,
        estimator,
        tried,
        known,
        settings.direct,
        settings.draws,
        columns,
        identity,
    )


def _grow_direct(
    matrix: DesignMatrix,
    guide: Int[ndarray, " m"],
    instance: Int[ndarray, " m"],
    settings: ForestSettings,
) -> Forest | None:
    """Grow the direct forest from all tried grasps; None if all outcomes are equal."""
    from sklearn.ensemble import ExtraTreesClassifier

    outcome = matrix.success[guide, instance] == 1
    if not outcome.any() or outcome.all():
        return None
    who = np.eye(len(matrix.success))[guide]
    which = np.eye(matrix.objects)[matrix.numbers[instance]]
    inputs = np.concatenate([matrix.features[guide, instance], which, who], axis=1)
    model = ExtraTreesClassifier(
        settings.trees,
        min_samples_leaf=2,
        max_features=0.5,
        random_state=settings.seed,
        n_jobs=-1,
    ).fit(inputs.astype(np.float32), outcome)
    return flatten(model)


def _trials(
    matrix: DesignMatrix,
    guide: Int[ndarray, " m"],
    instance: Int[ndarray, " m"],
    tried: Bool[ndarray, " o"],
) -> tuple[Float[ndarray, "t 4 4"], Int[ndarray, " t"], Bool[ndarray, " t"]]:
    """Return pose errors, objects and outcomes of trials.

    Those of tried grasps, and simulated ones of objects that have no tried grasp.
    """
    has_error = np.isfinite(matrix.obj_T_est[guide, instance]).all(axis=(1, 2))
    guide, instance = guide[has_error], instance[has_error]
    poses, numbers = matrix.obj_T_est[guide, instance], matrix.numbers[instance]
    success = matrix.success[guide, instance] == 1
    if matrix.simulated is None:
        return poses, numbers, success
    lacking = ~tried[matrix.simulated[1]]
    more = [part[lacking] for part in matrix.simulated]
    return (
        np.concatenate([poses, more[0]]),
        np.concatenate([numbers, more[1]]),
        np.concatenate([success, more[2]]),
    )


def _columns(names: Sequence[str]) -> Int[ndarray, " c"]:
    """Return the numbers of the columns that :attr:`Blend.columns` describes."""
    inputs = [
        i
        for i, name in enumerate(names)
        if (stem := name.split(".")[0]) in _STAGE_INPUTS or stem.split("_")[0] in _STAGE_INPUTS[:3]
    ]
    axes = [names.index(f"axis_{ray}{axis}") for ray in "xyz" for axis in "xyz"]
    return np.array([*inputs, *axes, names.index("distance"), len(inputs)], dtype=np.int64)
