"""What is kept from training: four protocols, each a list of tasks for a method.

A method sees a :class:`Task`: what it may learn from, and the estimates that it is asked about.
The outcomes that it is judged by are not in it, nor is the ground truth of what it is judged on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.alignment import Estimates
from graspcast.evaluation.benchmark import Benchmark
from graspcast.evaluation.predictions import Forecasts
from graspcast.forecasting.samples import Samples
from graspcast.forecasting.splits import by_scene
from graspcast.forecasting.training_data import SimulatedTrials
from graspcast.paper.published_split import published_part

__all__ = ["PROTOCOLS", "Method", "Task", "forecast", "tasks"]

FOLDS = 5

PROTOCOLS: Mapping[str, str] = {
    "random_split": (
        "The split published with the paper, for each principal and gripper: a random fifth of the "
        "instances is judged. Frames are video, so nearly every judged frame has a neighbour in "
        "training; this says nothing about a new scene."
    ),
    "unseen_scenes": (
        "Cross-validation in five parts of whole scenes (LM-O's only scene in five blocks of "
        "frames): every instance is judged once, by a model that saw no frame of its scene."
    ),
    "unseen_object": (
        "Each object left out in turn: no outcome and no ground truth of it, only its mesh and, "
        "for methods that use one, one's own simulation. Judged on the images that no reference "
        "grasp was fitted or chosen on."
    ),
    "unseen_gripper": (
        "No published outcome of the gripper: a method learns from the other gripper's, or from "
        "one's own simulation of this one. Scenes are kept apart as in unseen_scenes; judged on "
        "the images that no reference grasp was fitted or chosen on."
    ),
    "unseen_object_simulated": (
        "As unseen_object, but one's own campaign's outcomes are both what is learned from and "
        "what is judged by: grasp, mass and friction are then known exactly, as for an object of "
        "one's own."
    ),
}
"""Each protocol's name and what it means."""


@dataclass(frozen=True, eq=False)
class Task:
    """What a method may know, and what it is asked.

    Attributes
    ----------
    protocol
        The name of the protocol.
    principal, gripper
        Whose grasps are asked about.
    train
        The principal's outcomes to learn from; by the other gripper in ``unseen_gripper``.
    others
        The same instances' outcomes, as far as known, with the other estimators as principals.
    simulated
        Outcomes of one's own trials with :attr:`gripper` on instances that are not judged: this
        principal's first. Empty without a campaign.
    borrowed
        Trials with :attr:`gripper` of every object, by errors that estimators made on other
        objects; None if there are none.
    annotated
        Instances whose ground truth may be learned from: in ``unseen_object`` none of that object,
        else all that are kept apart from the judged ones.
    truth
        Their true poses ``cam_T_obj``, metres, (m, 4, 4).
    test
        The estimates of the instances that are asked about.
    models
        Dataset's name to its object models.
    left_out
        The object or gripper that is left out, if the protocol leaves one out.
    seed
        Of everything random.
    """

    protocol: str
    principal: str
    gripper: str
    train: Samples
    others: tuple[Samples, ...]
    simulated: tuple[Samples, ...]
    transferred: SimulatedTrials | None
    annotated: Estimates
    truth: Float[ndarray, "m 4 4"]
    test: Estimates
    models: Mapping[str, Models]
    left_out: str | None
    seed: int
    _look_up: Callable[[Estimates], Float[ndarray, "k 4 4"]]

    def truth_of(self, estimates: Estimates) -> Float[ndarray, "k 4 4"]:
        """True poses of instances that have outcomes here, simulated ones too.

        Raises
        ------
        MismatchError
            For an instance that is kept for judging.
        """
        return self._look_up(estimates)


@runtime_checkable
class Method(Protocol):
    """Learns from a task and answers it."""

    def __call__(self, task: Task) -> Float[ndarray, " n"]:
        """Probability of success of each instance of ``task.test``."""
        ...


@dataclass(frozen=True, eq=False)
class _Cut:
    """Rows of the benchmark: learned from, judged, with known truth, and open to no one."""

    train: Bool[ndarray, " n"]
    judged: Bool[ndarray, " n"]
    annotated: Bool[ndarray, " n"]
    closed: Bool[ndarray, " n"]
    learned_gripper: str
    left_out: str | None = None


def _scene_folds(benchmark: Benchmark, seed: int) -> Iterator[Bool[ndarray, " n"]]:
    """The rows of each part of the scenes; no outcome has a say in how they are dealt."""
    n = len(benchmark)
    blank = Samples(benchmark.estimates, "", "", np.zeros(n, dtype=bool))
    for _, test in by_scene(blank, folds=FOLDS, seed=seed):
        mask = np.zeros(n, dtype=bool)
        mask[test] = True
        yield mask


def _random_split(benchmark: Benchmark, principal: str, gripper: str) -> Iterator[_Cut]:
    every = Samples(benchmark.estimates, principal, gripper, np.zeros(len(benchmark), dtype=bool))
    part = published_part(every, benchmark.split)
    test = part == "test"
    yield _Cut(part == "train", test, ~test, test, gripper)


def _cuts(
    benchmark: Benchmark, protocol: str, principal: str, gripper: str, rows: ndarray, seed: int
) -> Iterator[_Cut]:
    if protocol == "random_split":
        for cut in _random_split(benchmark, principal, gripper):
            yield _Cut(cut.train, cut.judged & rows, cut.annotated, cut.closed, gripper)
    elif protocol == "unseen_scenes":
        for test in _scene_folds(benchmark, seed):
            yield _Cut(~test, test & rows, ~test, test, gripper)
    elif protocol == "unseen_gripper":
        grippers = sorted({g for _, g in benchmark.pairs()})
        others = [name for name in grippers if name != gripper]
        if len(others) != 1:
            raise InputError(
                f"unseen_gripper learns from one gripper and judges another, but there are "
                f"outcomes of {', '.join(grippers)}"
            )
        for test in _scene_folds(benchmark, seed):
            yield _Cut(~test, test & rows, ~test, test, others[0], gripper)
    else:
        objects = benchmark.estimates.objects
        for name in np.unique(objects):
            mine = objects == name
            yield _Cut(~mine, mine & rows, ~mine, mine & rows, gripper, str(name))


def tasks(
    benchmark: Benchmark,
    protocol: str,
    principal: str,
    gripper: str,
    *,
    rows: Bool[ndarray, " n"] | None = None,
    seed: int = 0,
) -> Iterator[tuple[Task, Samples]]:
    """The tasks of a protocol, each with the samples that it is judged by.

    Parameters
    ----------
    benchmark
        The data.
    protocol
        One of :data:`PROTOCOLS`.
    principal, gripper
        Whose grasps are judged.
    rows
        Which instances may be judged, (n,); by default the protocol's own: all of them, or where a
        simulation may take part, those in :attr:`Benchmark.reported`.
    seed
        Of how scenes are dealt out, and of the methods.

    Raises
    ------
    UnknownNameError
        For an unknown protocol.
    InputError
        If the protocol needs what is not there.
    """
    if protocol not in PROTOCOLS:
        raise UnknownNameError("protocol", protocol, PROTOCOLS)
    if protocol == "unseen_object_simulated":
        benchmark = benchmark.with_simulated_outcomes()
    if rows is None:
        alone = protocol in ("random_split", "unseen_scenes")
        rows = np.ones(len(benchmark), dtype=bool) if alone else benchmark.reported
    for cut in _cuts(benchmark, protocol, principal, gripper, rows, seed):
        judged = benchmark.samples(principal, gripper, cut.judged)
        if len(judged):
            yield _task(benchmark, protocol, principal, gripper, cut, judged, seed), judged


def _task(
    benchmark: Benchmark,
    protocol: str,
    principal: str,
    gripper: str,
    cut: _Cut,
    judged: Samples,
    seed: int,
) -> Task:
    def look_up(estimates: Estimates) -> ndarray:
        rows = benchmark.rows_of(estimates)
        if cut.closed[rows].any():
            raise MismatchError(
                f"{int(cut.closed[rows].sum())} of these instances are kept for judging "
                f"({protocol}); their ground truth is not for learning"
            )
        return benchmark.truth[rows]

    def samples(gripper: str, rows: ndarray, simulated: bool) -> dict[str, Samples]:
        """By principal, the asked one first."""
        names = [e for e, g in benchmark.pairs(simulated=simulated) if g == gripper]
        names.sort(key=lambda name: name != principal)
        return {name: benchmark.samples(name, gripper, rows, simulated=simulated) for name in names}

    own = {} if benchmark.simulated is None else samples(gripper, ~cut.closed, True)
    known = samples(cut.learned_gripper, cut.train, False)
    return Task(
        protocol=protocol,
        principal=principal,
        gripper=gripper,
        train=known.pop(principal),
        others=tuple(known.values()),
        simulated=tuple(own.values()),
        transferred=benchmark.transferred.get(gripper),
        annotated=benchmark.estimates.select(cut.annotated),
        truth=benchmark.truth[cut.annotated],
        test=judged.estimates,
        models=benchmark.models,
        left_out=cut.left_out,
        seed=seed,
        _look_up=look_up,
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
    progress: Callable[[float], None] | None = None,
) -> Forecasts:
    """A method's predictions in every task of a protocol.

    Parameters
    ----------
    method
        The method.
    name
        Its name in tables.
    benchmark, protocol, principal, gripper, rows, seed
        As for :func:`tasks`.
    progress
        Called with the share of the tasks that are done.

    Raises
    ------
    InputError
        If nothing is to be judged, or the method's answer is not one.
    """
    every = list(tasks(benchmark, protocol, principal, gripper, rows=rows, seed=seed))
    if not every:
        raise InputError(f"{protocol}: no grasp by {principal} and {gripper} to judge by")
    answers = []
    for i, (task, judged) in enumerate(every):
        answer = np.asarray(method(task), dtype=np.float64)
        if answer.shape != (len(judged),):
            raise MismatchError(
                f"{name} gave {answer.shape} probabilities for {len(judged)} instances"
            )
        answers.append(answer)
        if progress is not None:
            progress((i + 1) / len(every))
    samples = [judged for _, judged in every]
    return Forecasts(
        protocol=protocol,
        method=name,
        principal=principal,
        gripper=gripper,
        probability=np.concatenate(answers),
        success=np.concatenate([s.success for s in samples]),
        objects=np.concatenate([s.objects for s in samples]),
        scenes=np.concatenate([benchmark.scenes[benchmark.rows_of(s.estimates)] for s in samples]),
    )
