"""Evaluation protocols: what a method may be trained on, and what it is tested on.

A protocol is a list of tasks. A method sees a :class:`Task`: its training data and the estimates to
forecast. The task holds neither the outcomes nor the ground truth of the test instances.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.alignment import Estimates
from graspcast.evaluation.benchmark import Benchmark
from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.view_sets import BenchmarkViews
from graspcast.forecasting.simulated_trials import SimulatedTrials
from graspcast.forecasting.splits import by_group
from graspcast.forecasting.training_data import TrainingData
from graspcast.io.progress import Progress, step_of
from graspcast.paper.published_split import published_part

__all__ = ["PROTOCOLS", "Method", "Task", "forecast", "tasks"]

FOLDS = 5

PROTOCOLS: Mapping[str, str] = {
    "random_split": (
        "The split published with the paper, for each principal and gripper: a random fifth of the "
        "instances is for testing. Frames are video, so nearly every test frame has a neighbour in "
        "training; scores say nothing about a new scene."
    ),
    "unseen_scenes": (
        "Cross-validation in five folds of whole scenes (LM-O's only scene in five blocks of "
        "frames): every instance is tested once, by a model trained without its scene."
    ),
    "unseen_object": (
        "Each object left out in turn: training has no outcome and no ground truth of it, only its "
        "mesh and, for methods that use it, one's own simulation. Tested on the images on which no "
        "reference grasp was fitted or chosen."
    ),
    "unseen_gripper": (
        "Training has no published outcome of the gripper, only those of the other gripper, or "
        "one's own simulation of this one. Folds of scenes as in unseen_scenes; tested on the "
        "images on which no reference grasp was fitted or chosen."
    ),
    "unseen_object_simulated": (
        "As unseen_object, but the outcomes for training and testing are those of one's own "
        "campaign: grasp, mass and friction are then known exactly, as for an object of one's own."
    ),
}
"""Each protocol's name and description."""


@dataclass(frozen=True, eq=False)
class Task:
    """Training data and test estimates of one fold of a protocol.

    Attributes
    ----------
    protocol
        The name of the protocol.
    principal, gripper
        Estimator that guides the test grasps, and gripper.
    train
        Tried training instances with the principal's outcomes; in ``unseen_gripper`` those of the
        other gripper.
    others
        The same with each other estimator as principal.
    simulated
        Outcomes of one's own trials with :attr:`gripper` on instances that are not tested, with
        this principal first. Empty without a campaign.
    transferred
        Simulated trials with :attr:`gripper` of every object, by errors transferred from other
        objects; None if there are none.
    annotated
        Instances whose ground truth may be used: in ``unseen_object`` none of that object, else all
        that are not for testing.
    truth
        Their true poses ``cam_T_obj``, metres, (m, 4, 4).
    test
        Estimates of the instances to forecast.
    models
        Dataset's name to its object models.
    left_out
        The object or gripper that is left out, if the protocol leaves one out.
    seed
        Of everything random.
    views
        Fused poses of :attr:`annotated` and of :attr:`test`, where the benchmark has them.
    """

    protocol: str
    principal: str
    gripper: str
    train: TrainingData
    others: tuple[TrainingData, ...]
    simulated: tuple[TrainingData, ...]
    transferred: SimulatedTrials | None
    annotated: Estimates
    truth: Float[ndarray, "m 4 4"]
    test: Estimates
    models: Mapping[str, Models]
    left_out: str | None
    seed: int
    _look_up: Callable[[Estimates], Float[ndarray, "k 4 4"]]
    views: BenchmarkViews | None = None

    def truth_of(self, estimates: Estimates) -> Float[ndarray, "k 4 4"]:
        """Look up true poses of training instances, also of those in :attr:`simulated`.

        Raises
        ------
        MismatchError
            For a test instance.
        """
        return self._look_up(estimates)


@runtime_checkable
class Method(Protocol):
    """Learns from a task and answers it."""

    def __call__(self, task: Task) -> Float[ndarray, " n"]:
        """Probability of success of each instance of ``task.test``."""
        ...


@dataclass(frozen=True, eq=False)
class _Fold:
    """Rows of the benchmark, each a mask, (n,).

    Attributes
    ----------
    train
        Rows whose outcomes are for training.
    test
        Rows to forecast.
    annotated
        Rows whose ground truth may be used with :attr:`Task.annotated`.
    held_out
        Rows whose ground truth, and outcomes of one's own campaign, may not be used.
    gripper
        Gripper of the outcomes for training.
    left_out
        The object or gripper that is left out, if there is one.
    """

    train: Bool[ndarray, " n"]
    test: Bool[ndarray, " n"]
    annotated: Bool[ndarray, " n"]
    held_out: Bool[ndarray, " n"]
    gripper: str
    left_out: str | None = None


def _scene_folds(benchmark: Benchmark, seed: int) -> Iterator[Bool[ndarray, " n"]]:
    """Yield the test rows of each fold of scenes, which does not depend on outcomes."""
    objects = benchmark.estimates.objects
    for _, test in by_group(benchmark.scenes, objects, folds=FOLDS, seed=seed):
        yield np.isin(np.arange(len(benchmark)), test)


def _folds(
    benchmark: Benchmark, protocol: str, principal: str, gripper: str, seed: int
) -> Iterator[_Fold]:
    """Yield the folds of a protocol, with all instances that could be tested."""
    objects = benchmark.estimates.objects
    if protocol == "random_split":
        part = published_part(benchmark.estimates, principal, gripper, benchmark.split)
        test = part == "test"
        yield _Fold(part == "train", test, ~test, test, gripper)
    elif protocol == "unseen_scenes":
        for test in _scene_folds(benchmark, seed):
            yield _Fold(~test, test, ~test, test, gripper)
    elif protocol == "unseen_gripper":
        other = _other_gripper(benchmark, gripper)
        for test in _scene_folds(benchmark, seed):
            yield _Fold(~test, test, ~test, test, other, left_out=gripper)
    else:
        for name in np.unique(objects):
            test = objects == name
            yield _Fold(~test, test, ~test, test, gripper, left_out=str(name))


def _other_gripper(benchmark: Benchmark, gripper: str) -> str:
    grippers = sorted({name for _, name in benchmark.pairs()})
    others = [name for name in grippers if name != gripper]
    if len(others) != 1:
        raise InputError(
            "unseen_gripper is trained on one gripper and tested on another, but there are "
            f"outcomes of {', '.join(grippers)}",
            parameters=("protocols",),
        )
    return others[0]


def tasks(
    benchmark: Benchmark,
    protocol: str,
    principal: str,
    gripper: str,
    *,
    rows: Bool[ndarray, " n"] | None = None,
    seed: int = 0,
) -> Iterator[tuple[Task, TrainingData]]:
    """Yield the tasks of a protocol, each with its test instances and their outcomes.

    Parameters
    ----------
    benchmark
        The data.
    protocol
        One of :data:`PROTOCOLS`.
    principal, gripper
        Estimator that guides the test grasps, and gripper.
    rows
        Which instances may be tested, (n,); by default the protocol's own: all of them, or if a
        simulation may be involved, those in :attr:`Benchmark.reported`.
    seed
        Of the folds of scenes, and of the methods.

    Raises
    ------
    UnknownNameError
        For an unknown protocol.
    InputError
        If data that the protocol needs are missing.
    """
    if protocol not in PROTOCOLS:
        raise UnknownNameError("protocol", protocol, PROTOCOLS, parameters=("protocols",))
    if protocol == "unseen_object_simulated":
        benchmark = benchmark.with_simulated_outcomes()
    if rows is None:
        alone = protocol in ("random_split", "unseen_scenes")
        rows = np.ones(len(benchmark), dtype=bool) if alone else benchmark.reported
    by_object = protocol in ("unseen_object", "unseen_object_simulated")
    for fold in _folds(benchmark, protocol, principal, gripper, seed):
        tested = fold.test & rows
        if by_object:
            # One's own trials of a left-out object may be used on images that are not tested.
            fold = replace(fold, held_out=tested)
        test = benchmark.tried(principal, gripper, tested)
        if len(test):
            yield _task(benchmark, protocol, principal, gripper, fold, test.estimates, seed), test


def _task(
    benchmark: Benchmark,
    protocol: str,
    principal: str,
    gripper: str,
    fold: _Fold,
    test: Estimates,
    seed: int,
) -> Task:
    def look_up(estimates: Estimates) -> ndarray:
        rows = benchmark.rows_of(estimates)
        if fold.held_out[rows].any():
            raise MismatchError(
                f"{int(fold.held_out[rows].sum())} of these instances are for testing "
                f"({protocol}); their ground truth may not be used"
            )
        return benchmark.truth[rows]

    def tried(gripper: str, rows: ndarray, simulated: bool) -> dict[str, TrainingData]:
        """By principal, that of the task first."""
        names = [e for e, g in benchmark.pairs(simulated=simulated) if g == gripper]
        names.sort(key=lambda name: name != principal)
        return {name: benchmark.tried(name, gripper, rows, simulated=simulated) for name in names}

    own = {} if benchmark.simulated is None else tried(gripper, ~fold.held_out, True)
    known = tried(fold.gripper, fold.train, False)
    views = benchmark.views
    if views is not None:
        views = views.select(fold.annotated, benchmark.rows_of(test), len(benchmark))
    return Task(
        protocol=protocol,
        principal=principal,
        gripper=gripper,
        train=known.pop(principal),
        others=tuple(known.values()),
        simulated=tuple(own.values()),
        transferred=benchmark.transferred.get(gripper),
        annotated=benchmark.estimates.select(fold.annotated),
        truth=benchmark.truth[fold.annotated],
        test=test,
        models=benchmark.models,
        left_out=fold.left_out,
        seed=seed,
        _look_up=look_up,
        views=views,
    )


def forecast(
    method: Method,
    name: str,
    benchmark: Benchmark,
    protocol: str,
    principal: str,
    gripper: str,
    *,
    rows: Bool[ndarray, " n"] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Forecasts:
    """Compute the forecasts of a method in every task of a protocol.

    Parameters
    ----------
    method
        The method.
    name
        Its name in tables.
    benchmark, protocol, principal, gripper, rows, seed
        As for :func:`tasks`.
    progress
        Called with the share of the tasks that are done and a message.

    Raises
    ------
    InputError
        If there is no instance to test, or the method does not return probabilities.
    """
    every = list(tasks(benchmark, protocol, principal, gripper, rows=rows, seed=seed))
    if not every:
        raise InputError(
            f"{protocol}: no grasp guided by {principal} with the {gripper} gripper to test"
        )
    answers = []
    for i, (task, test) in enumerate(every):
        answer = np.asarray(method(task), dtype=np.float64)
        if answer.shape != (len(test),):
            raise MismatchError(
                f"{name} returned {answer.shape} probabilities for {len(test)} instances"
            )
        answers.append(answer)
        step_of(progress, i, len(every))(1.0, f"{protocol}: {name}")
    tested = [test for _, test in every]
    return Forecasts(
        protocol=protocol,
        method=name,
        principal=principal,
        gripper=gripper,
        probability=np.concatenate(answers),
        success=np.concatenate([t.own_success == 1 for t in tested]),
        objects=np.concatenate([t.objects for t in tested]),
        scenes=np.concatenate([benchmark.scenes[benchmark.rows_of(t.estimates)] for t in tested]),
    )
