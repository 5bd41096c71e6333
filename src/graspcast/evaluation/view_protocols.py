"""Protocols with several views: one model of each fold answers for all principals and rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import InputError
from graspcast.estimates.alignment import Estimates
from graspcast.evaluation.benchmark import Benchmark
from graspcast.evaluation.methods import training_data_of
from graspcast.evaluation.protocols import Task, tasks
from graspcast.evaluation.view_sets import ViewModelRule, ViewRow, ViewSet
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.train import fit_forecaster
from graspcast.forecasting.training_data import TrainingData
from graspcast.forecasting.view_rankings import view_probabilities
from graspcast.forecasting.view_verdicts import FUSED
from graspcast.io.progress import Progress, step_of

__all__ = [
    "VIEW_PROTOCOLS",
    "FoldForecasts",
    "FoldModels",
    "ViewFold",
    "forecast_fold",
    "forecast_views",
    "train_fold",
    "view_folds",
]

VIEW_PROTOCOLS: Mapping[str, str] = {
    "several_views": (
        "As unseen_scenes, with other images of the instance's scene as further views; on the "
        "instances that have another view, beside the blend's forecast from one view of the same "
        "instances. LM-O's views are images between which two other objects moved with this one."
    ),
    "several_views_unseen_object": "As unseen_object, with further views in the same way.",
}
"""Each protocol's name and description."""

_BASES = {"several_views": "unseen_scenes", "several_views_unseen_object": "unseen_object"}


@dataclass(frozen=True, eq=False)
class ViewFold:
    """One fold: the tasks of all principals, which share their training data.

    Attributes
    ----------
    gripper
        The gripper.
    tasks
        Principal's name to its task.
    tests
        Principal's name to the test instances with outcomes, for scoring alone.
    """

    gripper: str
    tasks: Mapping[str, Task]
    tests: Mapping[str, TrainingData]

    @property
    def first(self) -> Task:
        """The task whose training data are used."""
        return next(iter(self.tasks.values()))


def view_folds(
    benchmark: Benchmark, protocol: str, gripper: str, *, seed: int = 0
) -> Iterator[ViewFold]:
    """Yield the folds of a protocol with several views.

    Raises
    ------
    InputError
        If the benchmark has no fused poses.
    """
    if benchmark.views is None:
        raise InputError(f"{protocol} needs poses that are fused from several views")
    found: dict[frozenset[str], dict[str, tuple[Task, TrainingData]]] = {}
    by_object = protocol == "several_views_unseen_object"
    for principal in [p for p, g in benchmark.pairs() if g == gripper]:
        for task, test in tasks(benchmark, _BASES[protocol], principal, gripper, seed=seed):
            rows = benchmark.rows_of(test.estimates)
            names = [task.left_out or ""] if by_object else benchmark.scenes[rows]
            # Folds of scenes are the same for all principals, but not every scene is in each test.
            mine = next((k for k in found if k & set(names)), frozenset(names))
            into = found.pop(mine, {})
            into[principal] = (task, test)
            found[mine | frozenset(names)] = into
    for each in found.values():
        yield ViewFold(
            gripper, {p: t for p, (t, _) in each.items()}, {p: d for p, (_, d) in each.items()}
        )


@dataclass(frozen=True, eq=False)
class FoldForecasts:
    """Forecasts of one principal's grasps in one fold by one row of the table.

    Attributes
    ----------
    row
        The row.
    principal
        Whose pose guides the grasps.
    which
        Numbers among the task's test instances, (m,).
    probability
        With several views, (m,).
    one_view
        By the blend, from one view, (m,).
    """

    row: ViewRow
    principal: str
    which: Int[ndarray, " m"]
    probability: Float[ndarray, " m"]
    one_view: Float[ndarray, " m"]


@dataclass(frozen=True, eq=False)
class FoldModels:
    """The forecasters of one fold.

    Attributes
    ----------
    blend
        Trained with all estimators, the camera's motion and every guide.
    by_rule
        All forecasters with views.
    """

    blend: Forecaster
    by_rule: Mapping[ViewModelRule, Forecaster]


def train_fold(
    fold: ViewFold,
    rules: Sequence[ViewModelRule],
    settings: ForestSettings | None = None,
    *,
    progress: Progress | None = None,
) -> FoldModels:
    """Train the forecasters of a fold.

    Parameters
    ----------
    fold
        The fold.
    rules
        Of the models.
    settings
        Of the forests.
    progress
        Called with the share of the work that is done and a message.
    """
    task = fold.first
    assert task.views is not None
    data = training_data_of(task)
    base = ViewModelRule()
    # The direct forest knows nothing of an object that is left out; see methods.Forests.
    method = "two-stage" if task.left_out and data.simulated is not None else "blend"
    by_rule = {}
    wanted = list(dict.fromkeys([base, *rules]))
    for i, rule in enumerate(wanted):
        names = (rule.alone,) if rule.alone else data.estimates.estimators
        principal = rule.alone or task.principal
        mine = replace(data, principal=principal)
        mine = mine if rule.pooled else mine.only(*names)
        by_rule[rule] = fit_forecaster(
            replace(mine, views=task.views.train[rule]),
            # Only the view model of the others is used, to which the direct forest adds nothing.
            method=method if rule == base else "two-stage",
            guides=list(fold.tasks) if rule == base else [principal],
            forests=settings,
            models=task.models,
        )
        step_of(progress, i, len(wanted))(1.0, "training")
    return FoldModels(by_rule[base], by_rule)


def forecast_fold(
    fold: ViewFold, models: FoldModels, rows: Sequence[ViewRow]
) -> Iterator[FoldForecasts]:
    """Forecast the test instances of a fold that have several views, row by row.

    As :meth:`graspcast.Forecaster.judge` does: where the views contradict each other so that one is
    left, and for an object that the view model does not know, the forecast is that from one view.
    """
    for principal, task in fold.tasks.items():
        guided = models.blend.guided_by(principal)
        one_view = guided.probability(task.test, task.models, unseen_objects=True)
        one_view = np.nan_to_num(one_view, nan=0.0)
        assert task.views is not None
        for row in rows:
            if row.rule.alone not in ("", principal):
                continue
            found = task.views.test[row.fusion]
            which = found.data.row
            probability = forecast_views(
                models.by_rule[row.rule], found, task.test, principal, task.models
            )
            single = one_view[which]
            probability = np.where(np.isnan(probability), single, probability)
            if row.averaged:
                probability = (probability + single) / 2
            yield FoldForecasts(row, principal, which, probability, single)


def forecast_views(
    forecaster: Forecaster,
    found: ViewSet,
    estimates: Estimates,
    principal: str,
    models: Mapping[str, Models],
    *,
    least_views: int = 2,
) -> Float[ndarray, " m"]:
    """Forecast grasps guided by one estimator's single view, or by the fused pose.

    Parameters
    ----------
    forecaster
        Trained with views.
    found
        Fused poses of some of the instances.
    estimates
        The instances.
    principal
        An estimator's name, or ``fused``.
    models
        Dataset's name to its object models.
    least_views
        With fewer there is no forecast.

    Returns
    -------
        NaN where too few views are left, or the object is not known.
    """
    data = found.data
    out = np.full(len(data), np.nan)
    several: Bool[ndarray, " m"] = data.views >= least_views
    if not several.any() or forecaster.view_model is None:
        return out
    row, fused = data.row[several], data.cam_T_fused[several]
    guide = fused if principal == FUSED else estimates.of(principal)[row]
    instances = estimates.instances.select(row)
    given = (instances, data.statistics[several], fused, guide, models)
    out[several] = view_probabilities(forecaster, *given)
    return out
