"""The default forecaster: two stages and a direct forest, averaged and calibrated.

The direct forest sees the features and the object and answers with the success rate of alike
training instances. It knows what the two stages lump together, but nothing of an object without
outcomes; the two stages know what they were shown of each. Their average does better than either
on scenes that training has not seen (docs/evaluation.md). The average's log-odds are then stretched
and shifted by logistic regression on forecasts of scenes kept apart from training (Platt, 1999).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.instances import unit_names
from graspcast.forecasting.models.design_matrix import DesignMatrix
from graspcast.forecasting.models.encoding import one_hot_numbers
from graspcast.forecasting.models.forest import Forest, flatten
from graspcast.forecasting.models.out_of_fold import OutOfFold
from graspcast.forecasting.models.two_stage import ErrorModel, SuccessGivenError, expected_success
from graspcast.forecasting.training_data import TrainingData

__all__ = ["Blend", "ForestSettings"]

_STAGE_INPUTS = (
    "shift", "turn", "mid", "across_rel", "angle", "angle_between", "offset_between",
    "ray_between", "distance",
)  # fmt: skip
"""Stems of the columns that the error model sees: nothing that knows the object or the side from
which it is seen, which do better where scenes are new."""


@dataclass(frozen=True)
class ForestSettings:
    """How the forests are grown.

    Attributes
    ----------
    direct
        Weight of the direct forest for objects with outcomes; 0 is two stages alone, 1 the direct
        forest alone.
    trees
        Of each forest.
    draws
        Errors drawn for each forecast.
    folds
        Parts of the scenes for calibration; 0 for none.
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
    """Forests and their calibration, for one principal and gripper.

    Attributes
    ----------
    direct
        From features, object and guiding estimator to success, or None.
    errors, survival
        The two stages, or None.
    estimator
        One-hot vector of the principal among all estimators, (K,).
    tried
        Which objects have outcomes (the direct forest knows them), (objects,).
    known
        Which objects the second stage knows, by outcomes or simulation, (objects,).
    weight
        Of the direct forest.
    draws
        Errors drawn for each forecast.
    columns
        The error model's inputs among the features; the ray frame's nine; the distance.
    calibration
        Slope and shift of the log-odds, for the average and for two stages alone, (2, 2).
    apart
        What the calibration was learned from.
    """

    direct: Forest | None
    errors: ErrorModel | None
    success_given_error: SuccessGivenError | None
    estimator: Float[ndarray, "k"]
    tried: Bool[ndarray, "o"]
    known: Bool[ndarray, "o"]
    weight: float
    draws: int
    columns: Int[ndarray, "c"]
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
        progress: Callable[[float], None] | None = None,
    ) -> Blend:
        """Learn from lessons about these objects.

        Raises
        ------
        InputError
            If there is neither ground truth for two stages nor outcomes for the direct forest.
        """
        table = DesignMatrix.of(training_data, objects, models)
        groups = np.unique(table.groups)
        folds = min(settings.folds, len(groups))
        steps = folds + 1
        blend = _grow(table, np.full(len(training_data), True), settings)
        if progress is not None:
            progress(1 / steps)
        if folds < 2 or not blend.tried.any():
            return blend
        # Each scene's forecasts by forests that have not seen it.
        dealt = np.random.default_rng(settings.seed).permutation(len(groups)) % folds
        part = dealt[np.searchsorted(groups, table.groups)]
        forecasts = np.full((2, len(training_data)), np.nan)
        for fold in range(folds):
            inner = replace(settings, trees=max(32, settings.trees // 2))
            forest = _grow(table, part != fold, inner)
            rows = np.flatnonzero((part == fold) & table.samples)
            rows = rows[forest.tried[table.numbers[rows]]]
            forecasts[:, rows] = forest.raw(table.own[rows], table.numbers[rows])
            if progress is not None:
                progress((fold + 2) / steps)
        own = table.success[table.principal]
        calibration = np.stack([_calibrate(each, own) for each in forecasts])
        told = np.flatnonzero(~np.isnan(forecasts[0]))
        slope, shift = calibration[0]
        out_of_fold = OutOfFold(
            _expit(slope * _logit(forecasts[0, told]) + shift),
            own[told] == 1,
            unit_names(training_data.estimates.select(told).instances, "image"),
        )
        return replace(blend, calibration=calibration, out_of_fold=out_of_fold)

    def raw(
        self, features: Float[ndarray, "n d"], numbers: Int[ndarray, "n"]
    ) -> Float[ndarray, "2 n"]:
        """Before calibration: the average, and two stages alone; object -1 is an unseen one."""
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
                np.swapaxes(rows[:, axes].reshape(-1, 3, 3), 1, 2),
                rows[:, self.columns[-2]],
                numbers[mine],
                draws=self.draws,
            )
        if self.direct is None:
            return np.stack([staged, staged])
        which = one_hot_numbers(numbers, len(self.tried))
        guide = np.broadcast_to(self.estimator, (len(features), len(self.estimator)))
        direct = self.direct.mean(np.concatenate([features, which, guide], axis=1))
        # The direct forest knows only objects with outcomes, but is better than no answer.
        weight = np.where((numbers >= 0) & self.tried[numbers], self.weight, 0.0)
        weight = np.where(np.isnan(staged), 1.0, weight)
        mixed = weight * direct + (1 - weight) * np.nan_to_num(staged)
        return np.stack([mixed, staged])

    def probability(
        self, features: Float[ndarray, "n d"], objects: Int[ndarray, "n"]
    ) -> Float[ndarray, "n"]:
        """Probability of success of each row.

        Raises
        ------
        MismatchError
            For two stages alone, of an object without outcomes or simulated trials.
        """
        mixed, _ = self.raw(features, objects)
        if np.isnan(mixed).any():
            raise MismatchError(
                "two stages cannot answer for an object without outcomes or simulated trials: give "
                "some (train --simulated), or use the method blend"
            )
        # Two stages alone answer for what they know and the direct forest does not.
        alone = (objects >= 0) & self.known[objects] & ~self.tried[objects]
        slope, shift = self.calibration[alone.astype(int)].T
        return _expit(slope * _logit(mixed) + shift)

    def to_arrays(self) -> dict[str, ndarray]:
        """Named arrays."""
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
        """The inverse of :meth:`to_arrays`."""
        direct = errors = success_given_error = None
        if "direct/roots" in arrays:
            direct = Forest.from_arrays(arrays, "direct")
        if "success_given_error/roots" in arrays:
            errors = ErrorModel.from_arrays(arrays, "errors")
            success_given_error = SuccessGivenError(
                Forest.from_arrays(arrays, "success_given_error"), len(arrays["tried"])
            )
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


def _grow(table: DesignMatrix, rows: Bool[ndarray, "n"], settings: ForestSettings) -> Blend:
    """Forests of some of the instances, not calibrated."""
    guide, instance = np.nonzero(~np.isnan(table.success) & rows)
    tried = np.bincount(table.numbers[instance], minlength=table.objects) > 0
    columns = _columns(table.names)
    direct = errors = success_given_error = None
    known = np.zeros(table.objects, dtype=bool)
    if settings.direct > 0:
        direct = _grow_direct(table, guide, instance, settings)
    donors = rows & np.isfinite(table.truth[table.principal]).all(axis=1)
    if settings.direct < 1 and donors.any():
        poses, numbers, success = _trials(table, guide, instance, tried)
        known = np.bincount(numbers, minlength=table.objects) > 0
        if known.any():
            forest = {"trees": settings.trees, "seed": settings.seed}
            inputs = table.own[donors][:, columns[: columns[-1]]]
            errors = ErrorModel.fit(inputs, table.truth[table.principal][donors], **forest)
            success_given_error = SuccessGivenError.fit(
                poses, numbers, success, objects=table.objects, **forest
            )
    if direct is None and success_given_error is None:
        raise InputError(
            "there is nothing to learn from: two stages need ground truth and outcomes or "
            "simulated trials, the direct forest needs outcomes"
        )
    estimator = np.eye(len(table.success))[table.principal]
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
    table: DesignMatrix,
    guide: Int[ndarray, "m"],
    instance: Int[ndarray, "m"],
    settings: ForestSettings,
) -> Forest | None:
    """The direct forest of tried grasps, by who guided them; None if all came out alike."""
    from sklearn.ensemble import ExtraTreesClassifier

    outcome = table.success[guide, instance] == 1
    if not outcome.any() or outcome.all():
        return None
    who = np.eye(len(table.success))[guide]
    which = np.eye(table.objects)[table.numbers[instance]]
    inputs = np.concatenate([table.features[guide, instance], which, who], axis=1)
    model = ExtraTreesClassifier(
        settings.trees,
        min_samples_leaf=2,
        max_features=0.5,
        random_state=settings.seed,
        n_jobs=-1,
    ).fit(inputs.astype(np.float32), outcome)
    return flatten(model)


def _trials(
    table: DesignMatrix,
    guide: Int[ndarray, "m"],
    instance: Int[ndarray, "m"],
    tried: Bool[ndarray, "o"],
) -> tuple[Float[ndarray, "t 4 4"], Int[ndarray, "t"], Bool[ndarray, "t"]]:
    """Errors, objects and outcomes: of tried grasps, and simulated ones of objects without any."""
    has_error = np.isfinite(table.obj_T_est[guide, instance]).all(axis=(1, 2))
    guide, instance = guide[has_error], instance[has_error]
    poses, numbers = table.obj_T_est[guide, instance], table.numbers[instance]
    success = table.success[guide, instance] == 1
    if table.simulated is None:
        return poses, numbers, success
    # What was tried is better known than what was simulated.
    lacking = ~tried[table.simulated[1]]
    more = [part[lacking] for part in table.simulated]
    return (
        np.concatenate([poses, more[0]]),
        np.concatenate([numbers, more[1]]),
        np.concatenate([success, more[2]]),
    )


def _columns(names: Sequence[str]) -> Int[ndarray, "c"]:
    """Numbers of the error model's inputs, the nine axes and the distance; how many inputs."""
    inputs = [
        i
        for i, name in enumerate(names)
        if (stem := name.split(".")[0]) in _STAGE_INPUTS or stem.split("_")[0] in _STAGE_INPUTS[:3]
    ]
    axes = [names.index(f"axis_{ray}{axis}") for ray in "xyz" for axis in "xyz"]
    return np.array([*inputs, *axes, names.index("distance"), len(inputs)], dtype=np.int64)


def _logit(p: ndarray) -> ndarray:
    bounded = np.clip(p, 1e-3, 1 - 1e-3)
    return np.asarray(np.log(bounded / (1 - bounded)))


def _expit(x: ndarray) -> ndarray:
    return np.asarray(1 / (1 + np.exp(-x)))


def _calibrate(forecast: ndarray, outcome: ndarray) -> Float[ndarray, "2"]:
    """Slope and shift of the log-odds; none where outcomes are too few or all alike."""
    from sklearn.linear_model import LogisticRegression

    has = ~np.isnan(forecast) & ~np.isnan(outcome)
    if has.sum() < 20 or len(np.unique(outcome[has])) < 2:
        return np.array([1.0, 0.0])
    model = LogisticRegression(C=1.0).fit(_logit(forecast[has])[:, None], outcome[has])
    slope = float(model.coef_[0, 0])
    # Forecasts that say nothing about new scenes are not turned around.
    return np.array([slope, float(model.intercept_[0])]) if slope > 0 else np.array([1.0, 0.0])
