"""First looks at several scenes, judged in one batch of arrays.

A first look is one view. Its estimates are fused only where the advice may be to look again. A
frame with a pose that cannot be is left to :class:`~graspcast.forecasting.episodes.Episodes`, which
words what is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.bop.results import Results
from graspcast.errors import GraspcastError
from graspcast.estimates.checks import diameters
from graspcast.estimates.instances import split_object_name
from graspcast.forecasting.episode_verdict import EpisodeVerdict
from graspcast.forecasting.episodes import ONE_VIEW
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.grasp_ranking import Reachable
from graspcast.forecasting.verdict import VerdictRow, untrained_rows
from graspcast.forecasting.view_verdicts import FUSED, with_further_looks
from graspcast.pose.conventions import MIN_INSTANCES
from graspcast.pose.sanity import pose_problems
from graspcast.pose.transforms import compose
from graspcast.runtime.frame import Frame
from graspcast.views.camera_motion import CameraNoise
from graspcast.views.choice import MIN_PARALLAX_RAD, ViewRules
from graspcast.views.fused_estimates import FusedEstimates, check_estimators, fuse_gathered
from graspcast.views.fusion import FusedPoses
from graspcast.views.gathering import gather
from graspcast.views.spread import Spreads

__all__ = ["Batch", "Deciding"]

_ALONE = Spreads()


@dataclass(frozen=True, eq=False)
class Deciding:
    """By what first looks are decided.

    Attributes
    ----------
    forecaster
        The forecaster.
    models
        Dataset's name to its object models.
    order
        The estimators, those whose estimates are the instances first.
    options
        Of :meth:`Forecaster.judge`.
    max_looks
        Looks in all.
    """

    forecaster: Forecaster
    models: Mapping[str, Models] | None
    order: Sequence[str]
    options: Mapping[str, Any]
    max_looks: int


class Batch:
    """The estimates of one dataset's objects in several frames, whose numbers are the images."""

    def __init__(self, deciding: Deciding, frames: Sequence[Frame], dataset: str) -> None:
        self._by, self._frames, self._dataset = deciding, frames, dataset
        names = deciding.forecaster.card.estimators
        self._tables = {name: _table(name, frames, dataset) for name in names}

    def odd(self) -> Bool[ndarray, " f"]:
        """Return which frames hold a pose that cannot be."""
        tables = list(self._tables.values())
        obj_id = np.concatenate([t.obj_id for t in tables])
        images = np.concatenate([t.im_id for t in tables])
        size = diameters([self._dataset] * len(obj_id), obj_id.tolist(), self._by.models)
        said = pose_problems(np.concatenate([t.cam_T_obj for t in tables]), size)
        out = np.zeros(len(self._frames), dtype=bool)
        out[images[np.array([bool(text) for text in said], dtype=bool)]] = True
        return out

    def refusals(self) -> dict[int, GraspcastError]:
        """Return why frames with several instances cannot be right, if so."""
        out: dict[int, GraspcastError] = {}
        counts = {
            name: np.bincount(t.im_id, minlength=len(self._frames))
            for name, t in self._tables.items()
        }
        most = np.stack(list(counts.values())).max(axis=0)
        for i in np.flatnonzero(most >= MIN_INSTANCES).tolist():
            anchor = max(counts, key=lambda name: int(counts[name][i]))
            mine = {name: t.select(t.im_id == i) for name, t in self._tables.items()}
            try:
                check_estimators(mine, self._dataset, anchor, self._by.models)
            except GraspcastError as error:
                out[i] = error
        return out

    def verdicts(self, wanted: Bool[ndarray, " f"]) -> list[list[EpisodeVerdict]]:
        """Judge the first looks at the wanted frames; the others have no verdict."""
        out: list[list[EpisodeVerdict]] = [[] for _ in self._frames]
        done: set[tuple[int, int]] = set()
        images = frozenset((0, i) for i in np.flatnonzero(wanted).tolist())
        rules = ViewRules("earlier", 1, MIN_PARALLAX_RAD, CameraNoise(), images)
        for name in self._by.order:
            table = self._tables[name]
            pairs = set(zip(table.im_id.tolist(), table.obj_id.tolist(), strict=True))
            new = {pair for pair in pairs - done if wanted[pair[0]]}
            if not new:
                continue
            without = frozenset((0, *pair) for pair in pairs - new)
            for row in self._judged(name, replace(rules, without=without)):
                self._add(out, row)
            done |= new
        return out

    def _judged(self, principal: str, rules: ViewRules) -> list[VerdictRow]:
        by = self._by
        gathered = gather(self._tables, None, self._dataset, principal, _ALONE, {}, rules)
        keys = gathered.instances
        if not set(keys.objects.tolist()) & set(by.forecaster.card.objects):
            own, gripper = self._own(gathered.view_T_obj, principal), by.forecaster.card.gripper
            return untrained_rows(keys, own, principal=principal, gripper=gripper)
        n = len(keys)
        poses = FusedPoses(
            self._own(gathered.view_T_obj, principal),
            np.zeros((n, 6, 6)),
            gathered.present,
            np.zeros_like(gathered.present),
            np.zeros(n),
            gathered.view_T_obj,
        )
        names = tuple(self._tables)
        single = FusedEstimates(names, principal, keys, poses, gathered)
        options = {k: v for k, v in by.options.items() if k not in ("min_gain", "noise")}
        rows = by.forecaster.judge(single, by.models, reachable=self._reachable(), **options)
        waits = np.flatnonzero([not row.verdict.attempt for row in rows])
        if by.max_looks > 1 and by.options["threshold"] is not None and len(waits):
            self._advise(rows, single, waits)
        return rows

    def _own(self, poses: Float[ndarray, "n 1 k 4 4"], principal: str) -> Float[ndarray, "n 4 4"]:
        return poses[:, 0, list(self._tables).index(principal)]

    def _advise(
        self, rows: list[VerdictRow], single: FusedEstimates, waits: Int[ndarray, " m"]
    ) -> None:
        """Replace, where a further look pays, abstaining by looking again."""
        by = self._by
        fused = fuse_gathered(
            single.gathered.select(waits),
            _ALONE,
            names=single.estimators,
            dataset=self._dataset,
            principal=single.principal,
            models=by.models,
        )
        some = with_further_looks(
            by.forecaster,
            fused,
            [rows[i] for i in waits.tolist()],
            by.models,
            guide=by.options["guide"],
            max_looks=by.max_looks,
            min_gain=by.options["min_gain"],
            noise=by.options["noise"],
            world={
                (0, i): frame.world_T_cam
                for i, frame in enumerate(self._frames)
                if frame.world_T_cam is not None
            },
        )
        for i, row in zip(waits.tolist(), some, strict=True):
            rows[i] = row

    def _reachable(self) -> Reachable | None:
        frames, card = self._frames, self._by.forecaster.card
        if all(frame.reachable is None for frame in frames):
            return None
        return lambda key: frames[key.im_id].reachable_of(key.object, card.grasps_of(key.object))

    def _add(self, out: list[list[EpisodeVerdict]], row: VerdictRow) -> None:
        """Add the verdict on an instance to those of its frame."""
        mine = out[row.key.im_id]
        world_T_cam = self._frames[row.key.im_id].world_T_cam
        fused = self._by.options["guide"] == FUSED
        alone = self._by.forecaster.view_model is None and fused
        verdict = EpisodeVerdict(
            instance=len(mine),
            object_name=row.key.object,
            verdict=row.verdict,
            guide=row.principal,
            cam_T_obj=row.cam_T_obj,
            world_T_obj=None if world_T_cam is None else compose(world_T_cam, row.cam_T_obj),
            views=row.views,
            looks=1,
            row=replace(row, key=row.key._replace(im_id=0)),
            notes=(ONE_VIEW,) if alone else (),
        )
        mine.append(verdict)


def _table(name: str, frames: Sequence[Frame], dataset: str) -> Results:
    """Return an estimator's results of all frames, whose numbers are the images."""
    images, numbers, scores, poses = [], [], [], []
    for i, frame in enumerate(frames):
        for estimate in frame.estimates.get(name, ()):
            of, obj_id = split_object_name(estimate.object_name)
            if of == dataset:
                images.append(i)
                numbers.append(obj_id)
                scores.append(estimate.score)
                poses.append(estimate.cam_T_obj)
    n = len(images)
    zeros = np.zeros(n, dtype=np.int64)
    return Results(
        scene_id=zeros,
        im_id=np.array(images, dtype=np.int64),
        obj_id=np.array(numbers, dtype=np.int64),
        score=np.array(scores, dtype=np.float64),
        cam_T_obj=np.array(poses, dtype=np.float64).reshape(-1, 4, 4),
        time_s=np.full(n, -1.0),
        line=zeros,
        source=f"estimates by {name}",
    )
