"""A rehearsal: looks at made-up poses, so that the first real ones wait for nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from graspcast.errors import GraspcastError
from graspcast.estimates.instances import split_object_name
from graspcast.pose.transforms import transform
from graspcast.runtime.frame import Estimate, Frame

if TYPE_CHECKING:
    from graspcast.runtime.judging import Judge

__all__ = ["rehearse"]

_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def rehearse(judge: Judge) -> None:
    """Take two looks at one object, and a batch of first looks; nothing of it is kept."""
    name = judge.forecaster.card.objects[0]
    frames = [_frame(judge, name, i) for i in range(2)]
    dataset, _ = split_object_name(name)
    try:
        judge.first_looks(frames, dataset)
        episodes = judge.replayed(dataset, frames[:1])
        judge.look(episodes, frames[1])
    except GraspcastError:  # made-up poses may contradict each other
        return


def _frame(judge: Judge, name: str, number: int) -> Frame:
    """Return a frame in which the estimators disagree a little, from another side each time."""
    diameter_m = judge.forecaster.card.diameters_m.get(name, 0.1)
    R = np.linalg.matrix_power(_TURN, number)
    estimates = {}
    for k, estimator in enumerate(judge.forecaster.card.estimators):
        off = np.array([0.0, 0.02 * k * diameter_m, 8 * diameter_m])
        estimates[estimator] = [Estimate(name, transform(R, off))]
    return Frame(estimates, np.eye(4), time_s=float(number))
