"""Verdicts with several views, or one: attempt, look again from another side, or abstain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import MismatchError, UnknownNameError
from graspcast.estimates.alignment import Estimates, estimate_ids
from graspcast.estimates.checks import copied, diameters, no_estimate_by
from graspcast.estimates.instances import Instances
from graspcast.forecasting.contradictions import MOVED, single_view_doubts
from graspcast.forecasting.grasp_ranking import GraspForecast, Reachable, nothing_reachable
from graspcast.forecasting.look_again import MIN_GAIN, looks_for
from graspcast.forecasting.novelty import OOD_ALPHA
from graspcast.forecasting.verdict import Verdict, VerdictRow, check_threshold, chosen, decide
from graspcast.forecasting.view_rankings import view_ranking
from graspcast.io.arguments import a, checked
from graspcast.io.cached import cached_property
from graspcast.pose.sanity import pose_problems
from graspcast.views.camera_motion import CameraMotion, CameraNoise
from graspcast.views.fused_estimates import FusedEstimates
from graspcast.views.statistics import fusion_statistics

if TYPE_CHECKING:
    from graspcast.forecasting.forecaster import Forecaster

__all__ = ["BEST", "FUSED", "judge", "with_further_looks"]

FUSED = "fused"
"""The guide that is no estimator: the fused pose."""
BEST = "best"
"""Whoever has the highest probability guides, instance by instance."""


@checked(fused=a(FusedEstimates), guide=a(str, type(None), words="a name, or None"))
def judge(
    forecaster: Forecaster,
    fused: FusedEstimates,
    models: Mapping[str, Models] | None = None,
    *,
    guide: str | None = None,
    threshold: float | None = 0.5,
    guarantee: str | None = None,
    ood_alpha: float = OOD_ALPHA,
    max_looks: int = 1,
    min_gain: float = MIN_GAIN,
    motion: CameraMotion | None = None,
    noise: CameraNoise | None = None,
    seen: Mapping[str, Float[ndarray, " n"]] | None = None,
    reachable: Reachable | None = None,
) -> list[VerdictRow]:
    """Decide on every instance with as many views as there are.

    With several views the view model answers, with one the model of a single view; the reason says
    which. Where the other views contradict the judged image, or one does and no third decides which
    of the two is wrong, the verdict is to abstain, or to look again.

    One view of one estimator is a weak forecast: below the threshold the advice is to look again,
    also where the model was trained without views.

    Parameters
    ----------
    fused
        Poses fused from the estimators that the forecaster was trained with, of its principal's or
        another guide's instances.
    models
        Dataset's name to its object models.
    guide
        Whose pose guides the grasp: an estimator's name, ``fused``, or ``best``, whichever has the
        highest probability; None is the principal of ``fused``. From one view, ``fused`` is the
        principal.
    threshold, guarantee, ood_alpha
        As for :meth:`Forecaster.verdicts`.
    max_looks
        Images in all that a robot would take. Where fewer were, and the grasp is not attempted, the
        verdict is to look again if the expected probability of success after a further look, guided
        by the fused pose, is higher by ``min_gain`` or more; or if there is no forecast.
    min_gain
        As said.
    motion
        Camera poses, for directions in the world's frame.
    noise
        Of the camera motion to a further look.
    seen
        What is known of a single estimator's estimates in the judged image, by name: ``score`` and
        image fit, as :attr:`Estimates.seen` has them, (n,); the results' scores by default.
    reachable
        As for :meth:`Forecaster.rank`; keys are those of ``fused.instances``.

    Returns
    -------
        One row for each of ``fused.instances``, in order. ``principal`` names the guide, and
        ``est_id`` is the guide's own.

    Raises
    ------
    MismatchError
        For poses fused from other estimators, or objects of other sizes than in training.
    UnknownNameError
        For a guide that is none of these, or a reachable grasp that the forecaster does not know.
    """
    if threshold is not None:
        check_threshold(threshold)
    frame = _Frame.of(forecaster, fused, models, guide)
    if seen is not None:
        frame = replace(frame, seen=seen)
    options: dict[str, Any] = {"guarantee": guarantee, "ood_alpha": ood_alpha}
    options["reachable"] = reachable
    rows: dict[int, VerdictRow] = {}
    several, alone = np.flatnonzero(frame.several), np.flatnonzero(~frame.several)
    if len(several):
        found = frame.judged(several, threshold, **options)
        rows |= dict(zip(several.tolist(), found, strict=True))
    if len(alone):
        found = frame.single(threshold=threshold, **options)
        rows |= dict(zip(alone.tolist(), found, strict=True))
    out = [rows[i] for i in range(len(fused))]
    world = {} if motion is None else motion.world_T_cam
    if max_looks > 1 and threshold is not None:
        frame.look_again(out, max_looks, min_gain, world=world, noise=noise)
    return out


def with_further_looks(
    forecaster: Forecaster,
    fused: FusedEstimates,
    rows: Sequence[VerdictRow],
    models: Mapping[str, Models] | None = None,
    *,
    guide: str | None = None,
    max_looks: int,
    min_gain: float = MIN_GAIN,
    world: Mapping[tuple[int, int], Float[ndarray, "4 4"]],
    noise: CameraNoise | None = None,
) -> list[VerdictRow]:
    """Return verdicts with, where :func:`judge` would say so, the advice to look again.

    Parameters
    ----------
    forecaster, fused, models, guide, max_looks, min_gain, noise
        As for :func:`judge`.
    rows
        The verdicts on ``fused.instances`` without that advice.
    world
        Scene and image to the camera's pose in the world, metres, where it is known.
    """
    out, frame = list(rows), _Frame.of(forecaster, fused, models, guide)
    frame.look_again(out, max_looks, min_gain, world=world, noise=noise)
    return out


@dataclass(frozen=True, eq=False)
class _Frame:
    """Fused poses with what is needed to judge them."""

    forecaster: Forecaster
    fused: FusedEstimates
    models: Mapping[str, Models]
    guide: str
    several: Bool[ndarray, " n"]
    seen: Mapping[str, Float[ndarray, " n"]]

    @classmethod
    def of(
        cls,
        forecaster: Forecaster,
        fused: FusedEstimates,
        models: Mapping[str, Models] | None,
        guide: str | None,
    ) -> _Frame:
        card = forecaster.card
        if set(fused.estimators) != set(card.estimators):
            raise MismatchError(
                f"the poses are fused from {', '.join(fused.estimators)}, but this model was "
                f"trained with {', '.join(card.estimators)}: fuse from these",
                parameters=("estimates", "model"),
            )
        guide = fused.principal if guide is None else guide
        if guide not in (known := (*fused.estimators, FUSED, BEST)):
            raise UnknownNameError("guide", guide, known, parameters=("guide",))
        several = fused.views > 1
        if forecaster.view_model is None:
            several = np.zeros(len(fused), dtype=bool)
        seen = {"score": fused.gathered.score[:, 0]} if len(fused.estimators) == 1 else {}
        return cls(forecaster, fused, forecaster.models_or(models) or {}, guide, several, seen)

    @cached_property
    def statistics(self) -> Float[ndarray, "n d"]:
        """Of all fusions, (n, d)."""
        return fusion_statistics(self.fused)

    def candidates(
        self, rows: Int[ndarray, " m"]
    ) -> dict[str, tuple[Float[ndarray, "m 4 4"], Bool[ndarray, " m"], Int[ndarray, " m"]]]:
        """Return who may guide with several views: poses, where there is one, and ``est_id``."""
        fused, gathered = self.fused, self.fused.gathered
        out = {}
        if self.guide in (FUSED, BEST):
            there = np.ones(len(rows), dtype=bool)
            out[FUSED] = (fused.poses.cam_T_obj[rows], there, estimate_ids(fused.results)[rows])
        for k, name in enumerate(fused.estimators):
            if self.guide in (name, BEST):
                there, ids = gathered.present[rows, 0, k], gathered.est_id[rows, k]
                out[name] = (gathered.view_T_obj[rows, 0, k], there, ids)
        return out

    def judged(
        self,
        rows: Int[ndarray, " m"],
        threshold: float | None,
        *,
        guarantee: str | None,
        ood_alpha: float,
        reachable: Reachable | None,
    ) -> list[VerdictRow]:
        """Judge instances with several views."""
        fused, forecaster = self.fused, self.forecaster
        assert forecaster.view_model is not None
        candidates = self.candidates(rows)
        probability = np.full((len(candidates), len(rows)), np.nan)
        ranked: list[list[tuple[GraspForecast, ...]]] = [[()] * len(rows) for _ in candidates]
        for c, (poses, there, _) in enumerate(candidates.values()):
            mine = rows[there]
            ranking = view_ranking(
                forecaster,
                fused.instances.select(mine),
                self.statistics[mine],
                fused.poses.cam_T_obj[mine],
                poses[there],
                self.models,
                reachable,
            )
            probability[c, there] = ranking.probability
            for j, grasps in zip(np.flatnonzero(there).tolist(), ranking.grasps, strict=True):
                ranked[c][j] = grasps
        best = np.where(np.isnan(probability), -1.0, probability).argmax(axis=0).tolist()
        unusual = forecaster.view_model.assess(self.statistics[rows])
        names, keys = list(candidates), fused.instances.select(rows).to_keys()
        problems = self._problems(rows)
        out = []
        for j, i in enumerate(rows.tolist()):
            poses, there, est_id = candidates[names[best[j]]]
            problem = problems[j] or ("" if there[j] else no_estimate_by([names[best[j]]], {}))
            grasps = ranked[best[j]][j]
            if not (problem or grasps) and reachable is not None:
                problem = nothing_reachable(forecaster.card, keys[j].object)
            if problem:
                verdict = Verdict(False, None, problem)
            else:
                verdict = decide(
                    float(probability[best[j], j]),
                    threshold,
                    guarantee=guarantee,
                    disagreement=unusual[j],
                    ood_alpha=ood_alpha,
                )
                if forecaster.card.grasps and grasps:
                    verdict = chosen(verdict, grasps)
            views, entered = int(fused.views[i]), int(fused.poses.used[i].sum())
            said = f"{verdict.reason}; {views} views, {entered} estimates"
            row = VerdictRow(
                keys[j]._replace(est_id=int(est_id[j])) if there[j] else keys[j],
                principal=names[best[j]],
                gripper=forecaster.card.gripper,
                verdict=replace(verdict, reason=said),
                cam_T_obj=poses[j],
                grasp=verdict.grasp,
                views=views,
            )
            out.append(row)
        return out

    def look_again(
        self,
        rows: list[VerdictRow],
        max_looks: int,
        min_gain: float,
        *,
        world: Mapping[tuple[int, int], Float[ndarray, "4 4"]],
        noise: CameraNoise | None,
    ) -> None:
        """Replace, where a further look is allowed and pays, abstaining by looking again."""
        fused, forecaster = self.fused, self.forecaster
        if forecaster.view_model is None and forecaster.visibility is None:
            return
        known = np.isin(fused.instances.objects, forecaster.card.objects)
        taken = fused.gathered.present.any(axis=2).sum(axis=1)
        waits = np.array([not row.verdict.attempt for row in rows], dtype=bool)
        asked = np.flatnonzero(waits & known & (taken < max_looks))
        if not len(asked):
            return
        given = forecaster, fused, asked, self.statistics[asked], [rows[i].grasp for i in asked]
        looks = looks_for(*given, world=world, noise=noise)
        for i, look in zip(asked.tolist(), looks, strict=True):
            verdict, expected = rows[i].verdict, look.expected_probability
            if verdict.probability is None or expected is None:
                said, pays = "look again", True
            else:
                said = f"after a further look {expected:.3f} is expected"
                pays = expected >= verdict.probability + min_gain
            reason = f"{verdict.reason}; {said}{f' {look}' if pays else ', which does not pay'}"
            verdict = replace(verdict, reason=reason, look=look if pays else None)
            rows[i] = replace(rows[i], verdict=verdict)

    def _problems(self, rows: Int[ndarray, " m"]) -> list[str]:
        """Say for each instance with several views why there is no forecast, or nothing."""
        fused, card = self.fused, self.forecaster.card
        poses, keys = fused.poses.cam_T_obj[rows], fused.instances.select(rows)
        out = pose_problems(poses, self._sizes(keys))
        own = fused.poses.used[rows, 0].any(axis=1).tolist()
        whole = fused.gathered.present[rows, 0].all(axis=1)
        same = np.array([""] * len(rows), dtype=object)
        same[whole] = copied(
            fused.estimators, fused.gathered.view_T_obj[rows[whole], 0].swapaxes(0, 1)
        )
        known = set(card.objects)
        for j, name in enumerate(keys.objects.tolist()):
            if name not in known:
                out[j] = f"the model was not trained for {name}"
            elif out[j]:
                out[j] = f"the fused pose {out[j]}"
            elif not own[j]:
                out[j] = MOVED
            else:
                out[j] = same[j]
        return out

    def _sizes(self, keys: Instances) -> Float[ndarray, " m"]:
        """Return diameters, metres; those in training where there is no model."""
        trained = self.forecaster.card.diameters_of(keys.objects)
        given = diameters(keys.dataset.tolist(), keys.obj_id.tolist(), self.models)
        return np.where(np.isnan(given), trained, given)

    def single(self, **options: Any) -> list[VerdictRow]:
        """Judge instances with one view, by the model of a single view."""
        fused, gathered = self.fused, self.fused.gathered
        rows = np.flatnonzero(~self.several)
        first = fused.principal if self.guide in (FUSED, BEST) else self.guide
        names = self.forecaster.guides if self.guide == BEST else (first,)
        known = np.isin(fused.instances.objects[rows], self.forecaster.card.objects)
        whole = gathered.present[rows, 0].all(axis=1) & known
        poses = gathered.view_T_obj[rows, 0].swapaxes(0, 1)
        by_guide = {
            name: self._single(name, rows[whole], poses[:, whole], options) for name in names
        }
        keys, out = fused.instances.select(rows).to_keys(), []
        alone = self.forecaster.visibility is not None  # its verdicts say that it is one view
        place, doubts = np.cumsum(whole) - 1, single_view_doubts(fused)
        for j, i in enumerate(rows.tolist()):
            if not known[j]:
                why = f"the model was not trained for {keys[j].object}"
                name, verdict = first, Verdict(False, None, why)
            elif doubts[i]:
                name, verdict = first, Verdict(False, None, doubts[i])
            elif whole[j]:
                found = {name: given[place[j]] for name, given in by_guide.items()}
                name = max(found, key=lambda n: -1.0 if (p := found[n].probability) is None else p)
                verdict = found[name]
            else:
                name, there = first, gathered.present[i, 0]
                missing = [e for e, t in zip(fused.estimators, there, strict=True) if not t]
                verdict = Verdict(False, None, no_estimate_by(missing, {}))
            if known[j] and not (alone and verdict.probability is not None):
                verdict = replace(verdict, reason=f"{verdict.reason}; one view")
            est_id = int(gathered.est_id[i, (k := fused.estimators.index(name))])
            row = VerdictRow(
                keys[j]._replace(est_id=est_id) if est_id >= 0 else keys[j],
                principal=name,
                gripper=self.forecaster.card.gripper,
                verdict=verdict,
                cam_T_obj=poses[k, j],
                grasp=verdict.grasp,
            )
            out.append(row)
        return out

    def _single(
        self,
        guide: str,
        rows: Int[ndarray, " m"],
        poses: Float[ndarray, "k m 4 4"],
        options: dict[str, Any],
    ) -> list[Verdict]:
        if not len(rows):
            return []
        forecaster = self.forecaster.guided_by(guide)
        estimates = Estimates(
            self.fused.estimators,
            self.fused.instances.select(rows),
            poses,
            seen={name: values[rows][None] for name, values in self.seen.items()},
        )
        return forecaster.verdicts(estimates, self.models or None, **options)
