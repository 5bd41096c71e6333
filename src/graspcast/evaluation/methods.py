"""The methods that an evaluation compares, by name.

A method is a callable that forecasts a :class:`~graspcast.evaluation.protocols.Task`; as a frozen
dataclass its ``repr`` states its settings, which reports record. To add one, add a factory
that takes a seed to :data:`METHODS`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.evaluation.protocols import Method, Task
from graspcast.forecasting.features import consensus_features
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.models.encoding import one_hot
from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
from graspcast.forecasting.train import fit_forecaster
from graspcast.forecasting.training_data import TrainingData

__all__ = ["METHODS", "ExtraTrees", "Majority", "PaperNetworks", "Threshold", "success_rates"]


def success_rates(task: Task) -> Float[ndarray, " n"]:
    """Return each object's success rate in training; of an unknown object, that of all.

    One success and one failure are added to each (Laplace smoothing).
    """

    def rate(success: ndarray) -> float:
        return float((success.sum() + 1) / (len(success) + 2))

    objects, success = task.train.objects, task.train.own_success
    every = rate(success)
    known = {str(name): rate(success[objects == name]) for name in np.unique(objects)}
    return np.array([known.get(str(name), every) for name in task.test.objects])


def _or_never(probability: Float[ndarray, " n"]) -> Float[ndarray, " n"]:
    """Take what has no forecast, which verdicts abstain from, as never attempted."""
    return np.nan_to_num(probability, nan=0.0)


@dataclass(frozen=True)
class Majority:
    """Success rate of the object in training (of all, for an unknown object)."""

    seed: int = 0

    def __call__(self, task: Task) -> Float[ndarray, " n"]:
        """Forecast the test instances of a task."""
        return success_rates(task)


@dataclass(frozen=True)
class Threshold:
    """Threshold on ADD for each object (Shi et al., 2021), one for all where it is unknown."""

    seed: int = 0

    def __call__(self, task: Task) -> Float[ndarray, " n"]:
        """Forecast the test instances of a task."""
        forecaster = fit_forecaster(task.train, method="threshold", models=task.models)
        return _or_never(forecaster.probability(task.test, task.models, unseen_objects=True))


@dataclass(frozen=True)
class PaperNetworks:
    """The paper's networks and features after the last epoch, the mean of several seeds.

    Without pooling, the forecast of an object without a network is the success rate of all others.
    """

    pools_objects: bool
    members: int = 5
    epochs: int = 3000
    seed: int = 0

    def __call__(self, task: Task) -> Float[ndarray, " n"]:
        """Forecast the test instances of a task."""
        from graspcast.forecasting.models.mlp.types import MlpSettings

        out = success_rates(task)
        known = np.isin(task.test.objects, task.train.objects)
        asked = known | self.pools_objects
        if asked.any():
            settings = NetworkSettings(
                protocol="last",
                members=self.members,
                seed=self.seed,
                optimiser=MlpSettings(epochs=self.epochs),
            )
            method = "MLP-O" if self.pools_objects else "MLP"
            forecaster = fit_forecaster(task.train, method=method, settings=settings)
            test = task.test.select(asked)
            out[asked] = _or_never(forecaster.probability(test, unseen_objects=True))
        return out


@dataclass(frozen=True)
class ExtraTrees:
    """Extra-Trees (Geurts et al., 2006) on the rich features and the object's one-hot vector."""

    trees: int = 400
    min_samples_leaf: int = 2
    seed: int = 0

    def __call__(self, task: Task) -> Float[ndarray, " n"]:
        """Forecast the test instances of a task."""
        from sklearn.ensemble import ExtraTreesClassifier

        forest = ExtraTreesClassifier(
            n_estimators=self.trees,
            min_samples_leaf=self.min_samples_leaf,
            random_state=self.seed,
            n_jobs=1,
        )
        train, test = task.train.estimates, task.test
        known = tuple(sorted(set(train.objects.tolist())))
        table = []
        for estimates in (train, test):
            values = consensus_features(
                estimates, task.principal, which="rich", models=task.models
            ).values
            # The one-hot row of an unknown object is zero.
            names, seen = estimates.objects, np.isin(estimates.objects, known)
            which = np.zeros((len(names), len(known)))
            which[seen] = one_hot(names[seen].tolist(), known, "object")
            table.append(np.concatenate([values, which], axis=1))
        forest.fit(table[0], task.train.own_success == 1)
        probability = forest.predict_proba(table[1])
        succeeds = np.flatnonzero(forest.classes_)
        return probability[:, succeeds[0]] if len(succeeds) else np.zeros(len(test))


@dataclass(frozen=True)
class Forests:
    """The forecaster made of forests that ``method`` names."""

    method: str
    simulates: ClassVar[bool] = True
    """Whether it is trained on one's own trials, so that saved forecasts depend on them."""
    trees: int = 128
    draws: int = 128
    folds: int = 4
    seed: int = 0

    def __call__(self, task: Task) -> Float[ndarray, " n"]:
        """Forecast the test instances of a task."""
        settings = ForestSettings(
            trees=self.trees, draws=self.draws, folds=self.folds, seed=self.seed
        )
        data = training_data_of(task)
        if self.method == "direct" and np.isnan(data.success).all():
            # It cannot use simulated trials, so it uses the outcomes of the other gripper.
            data = training_data_of(task, any_gripper=True)
        elif np.isnan(data.success).all() and data.simulated is None:
            return success_rates(task)
        method = self.method
        if method == "blend" and data.simulated is not None and task.left_out is not None:
            # The direct forest has no outcomes of what is left out, so the blend equals the
            # two-stage model, which is faster to train.
            method = "two-stage"
        forecaster = fit_forecaster(data, method=method, forests=settings, models=task.models)
        out = success_rates(task)
        asked = np.isin(task.test.objects, forecaster.card.objects) | (method != "two-stage")
        if asked.any():
            test = task.test.select(asked)
            out[asked] = _or_never(forecaster.probability(test, task.models, unseen_objects=True))
        return out


@dataclass(frozen=True)
class Direct(Forests):
    """The direct forest of the blend, calibrated."""

    method: str = "direct"


@dataclass(frozen=True)
class TwoStage(Forests):
    """The two-stage model: pose error distribution, then success given error; calibrated."""

    method: str = "two-stage"


@dataclass(frozen=True)
class Blended(Forests):
    """The default: the average of direct forest and two-stage model, calibrated."""

    method: str = "blend"


def training_data_of(task: Task, *, any_gripper: bool = False) -> TrainingData:
    """Collect a task's training data: all annotated instances, with all known outcomes."""
    estimates = task.annotated
    row = {key: i for i, key in enumerate(estimates.instances.to_keys())}
    success = np.full((len(estimates.estimators), len(estimates)), np.nan)
    for tried in (task.train, *task.others):
        if tried.gripper != task.gripper and not any_gripper:
            continue
        rows = [row[key] for key in tried.estimates.instances.to_keys()]
        success[estimates.index(tried.principal), rows] = tried.own_success
    return TrainingData(
        estimates, task.principal, task.gripper, task.truth, success, simulated=task.transferred
    )


METHODS: dict[str, Callable[[int], Method]] = {
    "majority": lambda seed: Majority(seed=seed),
    "threshold": lambda seed: Threshold(seed=seed),
    "MLP": lambda seed: PaperNetworks(pools_objects=False, seed=seed),
    "MLP-O": lambda seed: PaperNetworks(pools_objects=True, seed=seed),
    "extra-trees": lambda seed: ExtraTrees(seed=seed),
    "direct": lambda seed: Direct(seed=seed),
    "two-stage": lambda seed: TwoStage(seed=seed),
    "blend": lambda seed: Blended(seed=seed),
}
"""Name to a factory that takes a seed."""
