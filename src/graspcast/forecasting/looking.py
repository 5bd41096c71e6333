"""The look-again policy on recorded data: one look, then as many more as its verdicts ask for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int
from numpy import ndarray

from graspcast.errors import InputError, MismatchError
from graspcast.estimates.loading import Inputs
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.novelty import OOD_ALPHA
from graspcast.forecasting.recorded_verdicts import ViewSettings, judge_recorded
from graspcast.forecasting.verdict import VerdictRow
from graspcast.forecasting.view_verdicts import FUSED
from graspcast.views.camera_motion import CameraMotion

__all__ = ["PolicyRun", "run_policy"]


@dataclass(frozen=True, eq=False)
class PolicyRun:
    """What the look-again policy did with each instance.

    Attributes
    ----------
    rows
        The verdict at which looking ended, in order of the instances. It is "look again" where the
        recorded views ended before the policy did.
    looks
        How many looks had been taken by then, (n,).
    stages
        The verdicts on all instances after one look, after two, and so on: what a robot that always
        takes so many looks would decide. An instance with fewer recorded views is judged with those
        it has.

    A fused pose that guides is named by the looks allowed to it: ``fused2``, ``fused3``. Each
    guides other grasps, and its ``est_id`` is that of poses fused with so many views at most.
    """

    rows: list[VerdictRow]
    looks: Int[ndarray, " n"]
    stages: tuple[list[VerdictRow], ...]

    def __repr__(self) -> str:
        counts = np.bincount(self.looks, minlength=2)[1:].tolist()
        said = ", ".join(f"{n} after {i}" for i, n in enumerate(counts, 1))
        return f"PolicyRun({len(self.rows)} instances by looks: {said})"


def run_policy(
    forecaster: Forecaster,
    inputs: Inputs,
    dataset: str,
    motion: CameraMotion | None,
    settings: ViewSettings,
    *,
    threshold: float | None = 0.5,
    guarantee: str | None = None,
    ood_alpha: float = OOD_ALPHA,
) -> PolicyRun:
    """Run the look-again policy over the recorded images of one dataset.

    Each instance of the guide's (or principal's) is judged with its own image. Where the verdict is
    to look again, it is judged with one further recorded view, and so on up to
    ``settings.max_looks``. The views are those that fusion chooses, not those that a verdict
    suggests: the recorded images are what there is.

    Parameters
    ----------
    forecaster
        Trained with views, if further looks are allowed.
    inputs
        Estimates; their notes get what is left out.
    dataset
        Which of the datasets.
    motion
        Its camera motion.
    settings
        The policy. ``max_views`` is not used: a stage has as many views as looks.
    threshold, guarantee, ood_alpha
        As for :meth:`Forecaster.judge`.

    Raises
    ------
    InputError
        If ``settings.max_looks`` is less than 1.
    MismatchError
        If further looks are allowed, but the forecaster was trained without views, or there is no
        camera motion.
    """
    if settings.max_looks < 1:
        raise InputError(f"max_looks should be 1 or more, not {settings.max_looks}")
    if settings.max_looks > 1 and forecaster.view_model is None:
        raise MismatchError(
            "further looks need a model that was trained with views: train it with camera poses",
            parameters=("model", "camera_poses"),
        )
    if settings.max_looks > 1 and motion is None:
        raise MismatchError("further looks need camera poses", parameters=("camera_poses",))
    stages: list[list[VerdictRow]] = []
    taken: list[ndarray] = []
    for looks in range(1, settings.max_looks + 1):
        stage = replace(settings, max_views=looks)
        options = {"threshold": threshold, "guarantee": guarantee, "ood_alpha": ood_alpha}
        fused, rows = judge_recorded(forecaster, inputs, dataset, motion, stage, **options)
        stages.append([_named(row, looks) for row in rows])
        taken.append(fused.gathered.present.any(axis=2).sum(axis=1))
    ended = _ended(stages, taken)
    chosen = [stages[end][i] for i, end in enumerate(ended.tolist())]
    return PolicyRun(chosen, ended + 1, tuple(stages))


def _named(row: VerdictRow, looks: int) -> VerdictRow:
    """Return a row whose fused guide is named by the looks allowed."""
    return replace(row, principal=f"{FUSED}{looks}") if row.principal == FUSED else row


def _ended(stages: list[list[VerdictRow]], taken: list[ndarray]) -> Int[ndarray, " n"]:
    """Return the number of the stage, from 0, at which looking at each instance ended."""
    out = np.zeros(len(stages[0]), dtype=np.int64)
    for later in range(1, len(stages)):
        before = stages[later - 1]
        asked = np.array([row.verdict.look is not None for row in before], dtype=bool)
        more = taken[later] > taken[later - 1]
        out[(out == later - 1) & asked & more] = later
    return out
