"""The look-again policy on recorded data: one look, then as many more as its verdicts ask for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.errors import InputError, MismatchError
from graspcast.estimates.instances import Instances
from graspcast.estimates.loading import Inputs
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.grasp_ranking import Reachable
from graspcast.forecasting.novelty import OOD_ALPHA
from graspcast.forecasting.recorded_verdicts import ViewSettings, judge_recorded
from graspcast.forecasting.verdict import InstanceLooks, VerdictRow
from graspcast.forecasting.view_verdicts import FUSED
from graspcast.io.progress import Progress, step_of
from graspcast.io.wording import counted
from graspcast.views.camera_motion import CameraMotion
from graspcast.views.fused_estimates import FusedEstimates

__all__ = ["PolicyRun", "ended_stages", "run_at_once", "run_policy"]


@dataclass(frozen=True, eq=False)
class PolicyRun:
    """What the look-again policy did with each instance.

    Attributes
    ----------
    instances
        Those of the guide's (or principal's), in order.
    rows
        The verdict at which looking ended. It is "look again" where the
        recorded views ended before the policy did.
    looks
        How many looks had been taken by then, (n,).
    stages
        The verdicts on all instances after one look, after two, and so on: what a robot that always
        takes so many looks would decide. An instance with fewer recorded views is judged with those
        it has.
    images
        How many images there were for each instance, at most as many as stages, (n,).

    A fused pose that guides is named by the looks allowed to it: ``fused2``, ``fused3``. Each
    guides other grasps, and its ``est_id`` is that of poses fused with so many views at most.
    """

    instances: Instances
    rows: list[VerdictRow]
    looks: Int[ndarray, " n"]
    stages: tuple[list[VerdictRow], ...]
    images: Int[ndarray, " n"]

    def __repr__(self) -> str:
        counts = np.bincount(self.looks, minlength=2)[1:].tolist()
        said = ", ".join(f"{n} after {i}" for i, n in enumerate(counts, 1))
        return f"PolicyRun({counted(len(self.rows), 'instance')} by looks: {said})"

    @property
    def each(self) -> list[InstanceLooks]:
        """The verdicts on each instance after one look, after two, and so on."""
        return [
            InstanceLooks(tuple(stage[i] for stage in self.stages[:images]), looks)
            for i, (images, looks) in enumerate(
                zip(self.images.tolist(), self.looks.tolist(), strict=True)
            )
        ]

    @property
    def probability(self) -> Float[ndarray, "n s"]:
        """The forecasts at which an attempt may be made, one column a stage.

        NaN where no threshold leads to an attempt: after looking ended, without a forecast, and out
        of distribution. Of a run at threshold 1 these are the forecasts of the policy at any
        threshold t, which attempts at the first of them that is t or more: whether a further look
        pays does not depend on the threshold.
        """
        out = np.full((len(self.rows), len(self.stages)), np.nan)
        for s, stage in enumerate(self.stages):
            for i in np.flatnonzero(self.looks > s).tolist():
                if (verdict := stage[i].verdict).may_attempt:
                    out[i, s] = verdict.probability
        return out


def ended_stages(goes_on: Bool[ndarray, "m n"]) -> Int[ndarray, " n"]:
    """Return the stage, from 0, at which looking at each instance ends.

    Parameters
    ----------
    goes_on
        Whether a further look follows each stage but the last, (stages - 1, n).
    """
    ends = np.zeros((1, goes_on.shape[1]), dtype=bool)
    return np.asarray(np.argmin(np.concatenate([goes_on, ends]), axis=0))


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
    reachable: Reachable | None = None,
    progress: Progress | None = None,
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
    threshold, guarantee, ood_alpha, reachable
        As for :meth:`Forecaster.judge`.
    progress
        Called with the share done and a short message.

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
    options: dict[str, Any] = {"threshold": threshold, "guarantee": guarantee}
    options |= {"ood_alpha": ood_alpha, "reachable": reachable}
    for looks in range(1, settings.max_looks + 1):
        stage = replace(settings, max_views=looks)
        step = step_of(progress, looks - 1, settings.max_looks)
        options["progress"] = step
        parts = judge_recorded(forecaster, inputs, dataset, motion, stage, **options)
        stages.append([_named(row, looks) for _, rows in parts for row in rows])
        there = [f.gathered.present.any(axis=2).sum(axis=1) for f, _ in parts]
        taken.append(np.concatenate(there))
    fused = [f for f, _ in parts]
    inputs.add_notes(_views_of_parts(fused))
    asked = [[row.verdict.look is not None for row in stage] for stage in stages[:-1]]
    more = np.diff(np.array(taken), axis=0) > 0
    ended = ended_stages(np.array(asked, dtype=bool).reshape(more.shape) & more)
    chosen = [stages[end][i] for i, end in enumerate(ended.tolist())]
    instances = Instances.concatenate([f.instances for f in fused])
    return PolicyRun(instances, chosen, ended + 1, tuple(stages), taken[-1])


def run_at_once(
    forecaster: Forecaster,
    inputs: Inputs,
    dataset: str,
    motion: CameraMotion | None,
    settings: ViewSettings,
    **options: Any,
) -> PolicyRun:
    """Judge the recorded images of one dataset with all the views there are, as a run of one stage.

    Parameters
    ----------
    forecaster, inputs, dataset, motion, settings, options
        As for :func:`run_policy`, but for ``settings.max_views``, which is used. A fused pose that
        guides is named ``fused``.
    """
    parts = judge_recorded(forecaster, inputs, dataset, motion, settings, **options)
    fused = [f for f, _ in parts]
    inputs.add_notes(_views_of_parts(fused))
    rows = [row for _, some in parts for row in some]
    once = np.ones(len(rows), dtype=np.int64)
    instances = Instances.concatenate([f.instances for f in fused])
    return PolicyRun(instances, rows, once, (rows,), once)


def _views_of_parts(fused: Sequence[FusedEstimates]) -> list[str]:
    """Say how many instances have single views and why, and which are not the principal's."""
    first, *others = fused
    out = first.gathered.single_views()
    for part in others:
        lacks = f"that {first.principal} lacks and {part.principal} has"
        out.append(f"judged {counted(len(part), 'instance')} {lacks}")
        out += [f"of those {lacks}, {text}" for text in part.gathered.single_views()]
    return out


def _named(row: VerdictRow, looks: int) -> VerdictRow:
    """Return a row whose fused guide is named by the looks allowed."""
    return replace(row, principal=f"{FUSED}{looks}") if row.principal == FUSED else row
