"""Growing of the forests of a blend, and their calibration by out-of-fold predictions.

The direct forest, success given error and the view model are the same whichever estimator guides;
each guide has an error model and a calibration of its own. Success given error and the calibration
with views also use the outcomes of estimators that are only learned from.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import InputError
from graspcast.estimates.instances import unit_names
from graspcast.forecasting.models.blend import Blend, ForestSettings
from graspcast.forecasting.models.calibration import calibrated, fit_calibration
from graspcast.forecasting.models.design_matrix import DesignMatrix
from graspcast.forecasting.models.forest import Forest, grow_forest
from graspcast.forecasting.models.held_out_choice import choose_held_out
from graspcast.forecasting.models.out_of_fold import OutOfFold
from graspcast.forecasting.models.targets import Targets
from graspcast.forecasting.models.two_stage import ErrorModel, SuccessGivenError
from graspcast.forecasting.models.view_model import ViewModel
from graspcast.forecasting.splits import fold_numbers
from graspcast.forecasting.training_data import TrainingData
from graspcast.io.progress import Progress, step_of

__all__ = ["grow_blends"]

_STAGE_INPUTS = (
    "shift", "turn", "mid", "across_rel", "angle", "angle_between", "offset_between",
    "ray_between", "distance",
)  # fmt: skip
"""Name stems of the features that are inputs of the error model. Features that depend on the object
or on the viewing direction are left out, which generalises better to new scenes."""


def grow_blends(
    training_data: TrainingData,
    guides: Sequence[str],
    targets: Targets,
    models: Mapping[str, Models],
    settings: ForestSettings,
    *,
    progress: Progress | None = None,
) -> dict[str, Blend]:
    """Train for several guides, and calibrate by out-of-fold predictions.

    Parameters
    ----------
    training_data
        Instances with outcomes; with several views if it has :attr:`TrainingData.views`.
    guides
        The estimators that may guide.
    targets
        The objects to forecast, and their grasps.
    models
        Dataset's name to its object models.
    settings
        Of the forests.
    progress
        Called with the share of the work that is done and a message.

    Returns
    -------
    Guide's name to its blend; they share all but error model and calibration.

    Raises
    ------
    InputError
        If there is neither ground truth for the two-stage model nor outcomes for the direct forest.
    """
    matrix = DesignMatrix.of(training_data, targets, models)
    numbers = [training_data.estimates.index(name) for name in guides]
    folds = min(settings.folds, len(np.unique(matrix.groups)))
    blends = _grow(matrix, np.full(len(training_data), True), settings, numbers)
    step_of(progress, 0, folds + 1)(1.0, "growing forests")
    if folds >= 2 and blends[numbers[0]].tried.any():
        images = unit_names(training_data.estimates.instances, "image")
        blends = _calibrated(matrix, blends, settings, folds, images, progress)
    return {name: blends[k] for name, k in zip(guides, numbers, strict=True)}


def _calibrated(
    matrix: DesignMatrix,
    blends: dict[int, Blend],
    settings: ForestSettings,
    folds: int,
    images: ndarray,
    progress: Progress | None,
) -> dict[int, Blend]:
    """Calibrate each guide's forecasts, and those with views for all guides together.

    The calibration is the same for all grasps. That of the grasp with the highest forecast, which
    is a little too high since it was chosen for it, is corrected by a second one.
    """
    singles, seen = _out_of_fold(matrix, settings, list(blends), folds, progress)
    views = _calibrated_views(matrix, next(iter(blends.values())).views, seen, images)
    out = {}
    for k, blend in blends.items():
        blend = replace(blend, views=views)
        predictions, own = singles[k], matrix.success[:, k]
        if matrix.names:
            calibration = np.stack(
                [fit_calibration(each.ravel(), own.ravel()) for each in predictions]
            )
            found = choose_held_out(calibrated(predictions[0], calibration[0]), own)
            if len(found.rows):
                kept = OutOfFold(found.probability, found.success, images[found.rows])
                blend = replace(
                    blend, calibration=calibration, choice=found.choice, out_of_fold=kept
                )
        out[k] = blend
    return out


def _calibrated_views(
    matrix: DesignMatrix, model: ViewModel | None, seen: Float[ndarray, "s j m"], images: ndarray
) -> ViewModel | None:
    if model is None or matrix.views is None:
        return model
    outcome = matrix.all_success[:, :, matrix.views.row]
    known = ~np.isnan(seen) & ~np.isnan(outcome)
    if not known.any():
        return model
    calibration = fit_calibration(seen[known], outcome[known])
    there = matrix.success.shape[1]  # what is kept is of those that are there at run time
    row = np.tile(matrix.views.row, there)
    flat = calibrated(seen[:, :there], calibration).reshape(len(seen), -1)
    found = choose_held_out(flat, outcome[:, :there].reshape(flat.shape))
    if not len(found.rows):
        return replace(model, calibration=calibration)
    kept = OutOfFold(found.probability, found.success, images[row[found.rows]])
    return replace(model, calibration=calibration, choice=found.choice, out_of_fold=kept)


def _out_of_fold(
    matrix: DesignMatrix,
    settings: ForestSettings,
    guides: list[int],
    folds: int,
    progress: Progress | None,
) -> tuple[dict[int, Float[ndarray, "2 s n"]], Float[ndarray, "s j m"]]:
    """Forecast tried instances by forests grown without their scene; NaN for all others.

    Returns
    -------
    Of each grasp: of each guide from one view, as :meth:`Blend.raw`; and of all estimators with
    several views, those that are only learned from last.
    """
    fold_of = fold_numbers(matrix.groups, folds, seed=settings.seed)
    inner = replace(settings, trees=max(32, settings.trees // 2))
    singles = {k: np.full((2, *matrix.numbers.shape), np.nan) for k in guides}
    views = matrix.views
    shape = matrix.all_success.shape[:2]
    seen = np.full((*shape, 0 if views is None else len(views.row)), np.nan)
    for fold in range(folds):
        try:
            grown = _grow(matrix, fold_of != fold, inner, guides)
        except InputError:  # all outcomes are in this fold, or all others are equal
            continue
        for k, blend in grown.items():
            asked = (fold_of == fold) & ~np.isnan(matrix.success[:, k]) & (matrix.numbers >= 0)
            grasp, rows = np.nonzero(asked & blend.tried[matrix.numbers])
            if matrix.names:
                given = matrix.features[k, rows], matrix.numbers[grasp, rows]
                singles[k][:, grasp, rows] = blend.raw(*given)
        if views is not None and blend.views is not None:
            _forecast_views(matrix, blend, fold_of == fold, seen)
        step_of(progress, fold + 1, folds + 1)(1.0, "growing forests")
    return singles, seen


def _forecast_views(
    matrix: DesignMatrix, blend: Blend, test: Bool[ndarray, " n"], seen: Float[ndarray, "s j m"]
) -> None:
    """Forecast the tried instances of a fold with several views, guided by each estimator."""
    views = matrix.views
    assert views is not None and blend.views is not None and blend.success_given_error is not None
    numbers = matrix.numbers[:, views.row]
    for k in range(seen.shape[1]):
        tried = ~np.isnan(matrix.all_success[:, k, views.row])
        asked = test[views.row] & (views.views > 1) & tried
        asked &= np.isfinite(views.guide[k]).all(axis=(1, 2))
        grasp, rows = np.nonzero(asked & blend.known[numbers] & (numbers >= 0))
        if len(rows):
            seen[grasp, k, rows] = blend.views.raw(
                blend.success_given_error,
                views.statistics[rows],
                views.fused[k, rows],
                views.guide[k, rows],
                numbers[grasp, rows],
                draws=blend.draws,
            )


_MOST_DIRECT, _MOST_GIVEN_ERROR = 30_000, 60_000
"""Trials at most from which the direct forest, and success given error, are grown where objects
have several grasps; of more, about equally many of each grasp are drawn."""


@dataclass(frozen=True, eq=False)
class _Trials:
    """Tried grasps: who guided which instance's, its target, and whether it held, (m,)."""

    guide: Int[ndarray, " m"]
    instance: Int[ndarray, " m"]
    numbers: Int[ndarray, " m"]
    success: Bool[ndarray, " m"]

    def select(self, which: Int[ndarray, " k"]) -> _Trials:
        """Select trials by number."""
        return _Trials(*(getattr(self, f.name)[which] for f in fields(self)))


def _drawn(numbers: Int[ndarray, " m"], count: int, seed: int) -> Int[ndarray, " k"]:
    """Draw at most so many trials, about equally many of each target; in order, (k,)."""
    if len(numbers) <= count:
        return np.arange(len(numbers))
    order = np.random.default_rng(seed).permutation(len(numbers))
    # The place of each trial among those of its target, in random order.
    by_target = order[np.argsort(numbers[order], kind="stable")]
    sorted_numbers = numbers[by_target]
    place = np.arange(len(numbers)) - np.searchsorted(sorted_numbers, sorted_numbers)
    return np.sort(by_target[np.argsort(place, kind="stable")[:count]])


def _grow(
    matrix: DesignMatrix, rows: Bool[ndarray, " n"], settings: ForestSettings, guides: list[int]
) -> dict[int, Blend]:
    """Grow the forests from some of the instances, without calibration."""
    usable = ~np.isnan(matrix.success) & rows & (matrix.numbers >= 0)[:, None]
    grasp, guide, instance = np.nonzero(usable)
    numbers = matrix.numbers[grasp, instance]
    count, codes = len(matrix.targets), matrix.targets.codes()
    tried = np.bincount(numbers, minlength=count) > 0
    columns = _columns(matrix.names) if matrix.names else np.zeros(1, dtype=np.int64)
    direct = success_given_error = views = None
    errors: dict[int, ErrorModel] = {}
    known = np.zeros(count, dtype=bool)
    forest = {"trees": settings.trees, "seed": settings.seed}
    if settings.direct > 0 and matrix.names:
        trials = _Trials(guide, instance, numbers, matrix.success[usable] == 1)
        direct = _grow_direct(matrix, trials, codes, settings)
    if settings.direct < 1 and (rows & np.isfinite(matrix.truth).all(axis=2).any(axis=0)).any():
        poses, numbers, success = _trials(matrix, rows, tried)
        known = np.bincount(numbers, minlength=count) > 0
        if known.any():
            views = _grow_views(matrix, rows, forest)
            if matrix.names:
                errors = _grow_errors(matrix, rows, guides, columns, forest)
            if errors or views is not None:
                if matrix.targets.has_several:
                    kept = _drawn(numbers, _MOST_GIVEN_ERROR, settings.seed)
                    poses, numbers, success = poses[kept], numbers[kept], success[kept]
                success_given_error = SuccessGivenError.fit(
                    poses, numbers, success, codes=codes, **forest
                )
    if direct is None and success_given_error is None:
        raise InputError(
            "there is nothing to learn from: the two-stage model needs ground truth and outcomes "
            "or simulated trials, the direct forest needs outcomes",
            parameters=("outcomes", "ground_truth", "bop", "simulated"),
        )
    identity = np.array([[1.0, 0.0], [1.0, 0.0]])
    return {
        k: Blend(
            direct,
            errors.get(k),
            success_given_error,
            np.eye(matrix.success.shape[1])[k],
            codes,
            tried,
            known,
            settings.direct,
            settings.draws,
            columns,
            identity,
            views=views,
        )
        for k in guides
    }


def _grow_errors(
    matrix: DesignMatrix,
    rows: Bool[ndarray, " n"],
    guides: list[int],
    columns: Int[ndarray, " c"],
    forest: dict[str, int],
) -> dict[int, ErrorModel]:
    """Grow each guide's error model, where its true poses are known."""
    out = {}
    for k in guides:
        annotated = rows & np.isfinite(matrix.truth[k]).all(axis=1)
        if annotated.any():
            inputs = matrix.features[k, annotated][:, columns[: columns[-1]]]
            out[k] = ErrorModel.fit(inputs, matrix.truth[k][annotated], **forest)
    return out


def _grow_views(
    matrix: DesignMatrix, rows: Bool[ndarray, " n"], forest: dict[str, int]
) -> ViewModel | None:
    if (views := matrix.views) is None:
        return None
    mine = rows[views.row] & np.isfinite(views.truth).all(axis=1)
    if not (mine & (views.views > 1)).any():
        return None
    return ViewModel.fit(
        views.statistics[mine],
        views.truth[mine],
        views.row[mine],
        views.views[mine],
        trees=forest["trees"],
        seed=forest["seed"],
    )


def _grow_direct(
    matrix: DesignMatrix,
    trials: _Trials,
    codes: Float[ndarray, "t c"],
    settings: ForestSettings,
) -> Forest | None:
    """Grow the direct forest from all tried grasps; None if all outcomes are equal."""
    from sklearn.ensemble import ExtraTreesClassifier

    if matrix.targets.has_several:
        trials = trials.select(_drawn(trials.numbers, _MOST_DIRECT, settings.seed))
    guide, outcome = trials.guide, trials.success
    if not outcome.any() or outcome.all():
        return None
    who = np.eye(matrix.success.shape[1])[guide]
    features = matrix.features[guide, trials.instance]
    inputs = np.concatenate([features, codes[trials.numbers], who], axis=1)
    model = ExtraTreesClassifier(
        settings.trees,
        min_samples_leaf=2,
        max_features=0.5,
        random_state=settings.seed,
        n_jobs=-1,
    )
    return grow_forest(model, inputs, outcome)


def _trials(
    matrix: DesignMatrix, rows: Bool[ndarray, " n"], tried: Bool[ndarray, " o"]
) -> tuple[Float[ndarray, "t 4 4"], Int[ndarray, " t"], Bool[ndarray, " t"]]:
    """Return pose errors, targets and outcomes of trials.

    Those of tried grasps, whoever guided them, and simulated ones of targets that have none.
    """
    outcomes, errors = matrix.all_success, matrix.all_errors
    has_error = np.isfinite(errors).all(axis=(2, 3))
    usable = ~np.isnan(outcomes) & has_error & rows & (matrix.numbers >= 0)[:, None]
    grasp, guide, instance = np.nonzero(usable)
    poses, numbers = errors[guide, instance], matrix.numbers[grasp, instance]
    success = outcomes[usable] == 1
    if matrix.simulated is None:
        return poses, numbers, success
    tried = tried | (np.bincount(numbers, minlength=len(tried)) > 0)
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
