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
from graspcast.consensus import consensus_features
from graspcast.errors import InputError
from graspcast.geometry import compose, invert
from graspcast.learning.forests import Forest, flatten
from graspcast.learning.lessons import Lessons
from graspcast.learning.predictors import UNSEEN
from graspcast.learning.samples import scene_groups
from graspcast.learning.two_stage import ErrorModel, Survival, expected_survival
from graspcast.pose_error import nearest_symmetric
from graspcast.rays import relative

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

    Attributes:
        direct: Weight of the direct forest for objects with outcomes; 0 is two stages alone, 1 the
            direct forest alone.
        trees: Of each forest.
        draws: Errors drawn for each forecast.
        folds: Parts of the scenes for calibration; 0 for none.
        seed: Of everything random.
    """

    direct: float = 0.5
    trees: int = 128
    draws: int = 128
    folds: int = 4
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Blend:
    """Forests and their calibration, for one principal and gripper.

    Attributes:
        direct: From features, object and guiding estimator to success, or None.
        errors, survival: The two stages, or None.
        estimator: One-hot vector of the principal among all estimators, (K,).
        tried: Which objects have outcomes (the direct forest knows them), (objects,).
        known: Which objects the second stage knows, by outcomes or simulation, (objects,).
        weight: Of the direct forest.
        draws: Errors drawn for each forecast.
        columns: The error model's inputs among the features; the ray frame's nine; the distance.
        calibration: Slope and shift of the log-odds, for the average and for two stages alone,
            (2, 2).
    """

    direct: Forest | None
    errors: ErrorModel | None
    survival: Survival | None
    estimator: Float[ndarray, "k"]
    tried: Bool[ndarray, "o"]
    known: Bool[ndarray, "o"]
    weight: float
    draws: int
    columns: Int[ndarray, "c"]
    calibration: Float[ndarray, "2 2"]

    @classmethod
    def fit(
        cls,
        lessons: Lessons,
        objects: Sequence[str],
        models: Mapping[str, Models],
        settings: ForestSettings,
        *,
        progress: Callable[[float], None] | None = None,
    ) -> Blend:
        """Learn from lessons about these objects.

        Raises:
            InputError: if there is neither ground truth for two stages nor outcomes for the direct
                forest.
        """
        table = _Table.of(lessons, objects, models)
        groups = np.unique(table.groups)
        folds = min(settings.folds, len(groups))
        steps = folds + 1
        blend = _grow(table, np.full(len(lessons), True), settings)
        if progress is not None:
            progress(1 / steps)
        if folds < 2 or not blend.tried.any():
            return blend
        # Each scene's forecasts by forests that have not seen it.
        dealt = np.random.default_rng(settings.seed).permutation(len(groups)) % folds
        part = dealt[np.searchsorted(groups, table.groups)]
        forecasts = np.full((2, len(lessons)), np.nan)
        for fold in range(folds):
            inner = replace(settings, trees=max(32, settings.trees // 2))
            forest = _grow(table, part != fold, inner)
            rows = np.flatnonzero((part == fold) & table.samples)
            rows = rows[forest.tried[table.numbers[rows]]]
            forecasts[:, rows] = forest.raw(table.own[rows], table.numbers[rows])
            if progress is not None:
                progress((fold + 2) / steps)
        own = table.success[table.principal]
        return replace(blend, calibration=np.stack([_calibrate(each, own) for each in forecasts]))

    def raw(
        self, features: Float[ndarray, "n d"], numbers: Int[ndarray, "n"]
    ) -> Float[ndarray, "2 n"]:
        """Before calibration: the average, and two stages alone; object -1 is an unseen one."""
        count = self.columns[-1]  # of the error model's inputs
        inputs, axes = self.columns[:count], self.columns[count : count + 9]
        staged = np.full(len(features), np.nan)
        if self.errors is not None and self.survival is not None:
            mine = np.flatnonzero((numbers >= 0) & self.known[numbers])
            rows = features[mine]
            staged[mine] = expected_survival(
                self.errors,
                self.survival,
                rows[:, inputs],
                np.swapaxes(rows[:, axes].reshape(-1, 3, 3), 1, 2),
                rows[:, self.columns[-2]],
                numbers[mine],
                draws=self.draws,
            )
        if self.direct is None:
            return np.stack([staged, staged])
        one_hot = np.concatenate([np.eye(len(self.tried)), np.zeros((1, len(self.tried)))])
        guide = np.broadcast_to(self.estimator, (len(features), len(self.estimator)))
        direct = self.direct.mean(np.concatenate([features, one_hot[numbers], guide], axis=1))
        # The direct forest knows only objects with outcomes, but is better than no answer.
        weight = np.where((numbers >= 0) & self.tried[numbers], self.weight, 0.0)
        weight = np.where(np.isnan(staged), 1.0, weight)
        mixed = weight * direct + (1 - weight) * np.nan_to_num(staged)
        return np.stack([mixed, staged])

    def probability(
        self, features: Float[ndarray, "n d"], objects: Int[ndarray, "n"]
    ) -> Float[ndarray, "n"]:
        """Probability of success of each row."""
        mixed, _ = self.raw(features, objects)
        alone = (objects < 0) | ~self.tried[objects]
        slope, shift = self.calibration[alone.astype(int)].T
        return _expit(slope * _logit(mixed) + shift)

    def to_arrays(self) -> dict[str, ndarray]:
        """Named arrays."""
        plain = ("estimator", "tried", "known", "columns", "calibration")
        out = {name: getattr(self, name) for name in plain}
        out |= {"weight": np.array(self.weight), "draws": np.array(self.draws)}
        if self.direct is not None:
            out |= self.direct.to_arrays("direct")
        if self.errors is not None and self.survival is not None:
            out |= self.errors.to_arrays("errors") | self.survival.forest.to_arrays("survival")
        return out

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ndarray]) -> Blend:
        """The inverse of :meth:`to_arrays`."""
        direct = errors = survival = None
        if "direct/roots" in arrays:
            direct = Forest.from_arrays(arrays, "direct")
        if "survival/roots" in arrays:
            errors = ErrorModel.from_arrays(arrays, "errors")
            survival = Survival(Forest.from_arrays(arrays, "survival"), len(arrays["tried"]))
        return cls(
            direct,
            errors,
            survival,
            arrays["estimator"],
            arrays["tried"],
            arrays["known"],
            float(arrays["weight"]),
            int(arrays["draws"]),
            arrays["columns"],
            arrays["calibration"],
        )


@dataclass(frozen=True, eq=False)
class _Table:
    """Lessons as numbers: for each estimator as the one that guides, its features and outcomes."""

    principal: int
    names: tuple[str, ...]
    features: Float[ndarray, "k n d"]
    success: Float[ndarray, "k n"]
    truth: Float[ndarray, "k n 6"]
    obj_T_est: Float[ndarray, "k n 4 4"]
    numbers: Int[ndarray, "n"]
    groups: ndarray
    objects: int
    simulated: tuple[ndarray, ndarray, ndarray] | None

    @property
    def own(self) -> Float[ndarray, "n d"]:
        """The principal's features."""
        return self.features[self.principal]

    @property
    def samples(self) -> Bool[ndarray, "n"]:
        """Which instances have an outcome of the principal's."""
        return ~np.isnan(self.success[self.principal])

    @classmethod
    def of(cls, lessons: Lessons, objects: Sequence[str], models: Mapping[str, Models]) -> _Table:
        estimates = lessons.estimates
        number = {name: i for i, name in enumerate(objects)}
        # What has neither outcomes nor simulated trials still shows how estimators err.
        numbers = np.array(
            [number.get(name, UNSEEN) for name in estimates.objects.tolist()], dtype=np.int64
        )
        names: tuple[str, ...] = ()
        features, truths, errors = [], [], []
        for name in estimates.estimators:
            found = consensus_features(estimates, name, which="full", models=models)
            names = found.names if name == lessons.principal else names
            features.append(found.values)
            poses = estimates.of(name)
            # A turn by a symmetry is no error.
            est_T_true = compose(invert(poses), lessons.truth)
            for key in set(zip(estimates.dataset.tolist(), estimates.obj_id.tolist(), strict=True)):
                mine = (estimates.dataset == key[0]) & (estimates.obj_id == key[1])
                mine &= lessons.has_truth
                symmetries = models[key[0]][key[1]].symmetries
                est_T_true[mine] = nearest_symmetric(est_T_true[mine], symmetries)
            near = compose(poses, est_T_true)
            truths.append(np.full((len(near), 6), np.nan))
            truths[-1][lessons.has_truth] = relative(
                poses[lessons.has_truth], near[lessons.has_truth]
            )
            errors.append(invert(est_T_true))
        simulated = None
        if lessons.simulated is not None:
            mine = np.isin(lessons.simulated.objects, list(number))
            trials = lessons.simulated.select(mine)
            simulated = (
                trials.obj_T_est,
                np.array([number[name] for name in trials.objects.tolist()], dtype=np.int64),
                trials.success,
            )
        return cls(
            estimates.index(lessons.principal),
            names,
            np.stack(features),
            lessons.success,
            np.stack(truths),
            np.stack(errors),
            numbers,
            scene_groups(estimates),
            len(objects),
            simulated,
        )


def _grow(table: _Table, rows: Bool[ndarray, "n"], settings: ForestSettings) -> Blend:
    """Forests of some of the instances, not calibrated."""
    count = table.objects
    k = len(table.success)
    guide, instance = np.nonzero(~np.isnan(table.success) & rows)
    outcome = table.success[guide, instance] == 1
    tried = np.bincount(table.numbers[instance], minlength=count) > 0
    direct = None
    if settings.direct > 0 and outcome.any() and not outcome.all():
        from sklearn.ensemble import ExtraTreesClassifier

        inputs = np.concatenate(
            [
                table.features[guide, instance],
                np.eye(count)[table.numbers[instance]],
                np.eye(k)[guide],
            ],
            axis=1,
        )
        model = ExtraTreesClassifier(
            settings.trees,
            min_samples_leaf=2,
            max_features=0.5,
            random_state=settings.seed,
            n_jobs=-1,
        ).fit(inputs.astype(np.float32), outcome)
        direct = flatten(model)
    errors = survival = None
    known = np.zeros(count, dtype=bool)
    columns = _columns(table.names)
    donors = rows & np.isfinite(table.truth[table.principal]).all(axis=1)
    if settings.direct < 1 and donors.any():
        has_error = np.isfinite(table.obj_T_est[guide, instance]).all(axis=(1, 2))
        guide, instance, outcome = guide[has_error], instance[has_error], outcome[has_error]
        trials = [(table.obj_T_est[guide, instance], table.numbers[instance], outcome)]
        if table.simulated is not None:
            # What was tried is better known than what was simulated.
            lacking = ~tried[table.simulated[1]]
            trials.append(tuple(part[lacking] for part in table.simulated))
        poses, numbers, success = (np.concatenate(part) for part in zip(*trials, strict=True))
        known = np.bincount(numbers, minlength=count) > 0
        if known.any():
            inputs = table.own[donors][:, columns[: columns[-1]]]
            errors = ErrorModel.fit(
                inputs, table.truth[table.principal][donors], trees=settings.trees,
                seed=settings.seed,
            )  # fmt: skip
            survival = Survival.fit(
                poses, numbers, success, objects=count, trees=settings.trees, seed=settings.seed
            )
    if direct is None and survival is None:
        raise InputError(
            "there is nothing to learn from: two stages need ground truth and outcomes or "
            "simulated trials, the direct forest needs outcomes"
        )
    estimator = np.eye(k)[table.principal]
    identity = np.array([[1.0, 0.0], [1.0, 0.0]])
    return Blend(
        direct, errors, survival, estimator, tried, known, settings.direct, settings.draws,
        columns, identity,
    )  # fmt: skip


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
