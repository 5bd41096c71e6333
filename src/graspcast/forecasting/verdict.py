"""Verdicts: attempt a grasp, look again or abstain."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.instances import InstanceKey, Instances
from graspcast.estimates.outcomes import REFERENCE_GRASP
from graspcast.forecasting.grasp_ranking import GraspForecast
from graspcast.forecasting.novelty import OOD_ALPHA, Disagreement
from graspcast.io.arguments import number
from graspcast.io.wording import counted
from graspcast.views.next_look import NextLook

__all__ = [
    "InstanceLooks",
    "Verdict",
    "VerdictRow",
    "check_threshold",
    "decide",
    "said_by",
    "untrained_rows",
    "verdict_rows",
]

_is_share, _ = number(0.0, 1.0)


@dataclass(frozen=True)
class Verdict:
    """Whether to attempt a grasp, look again or abstain, and why.

    Attributes
    ----------
    attempt
        Whether to attempt it.
    probability
        The probability of success; None where there is no forecast.
    reason
        Why, in a few words.
    threshold
        The least probability that is attempted; None where there is no forecast.
    guarantee
        What the threshold was certified to keep, if it was.
    p_value
        Conformal p-value of the disagreement under the training data; None where not asked for.
    out_of_distribution
        Whether the disagreement is too unusual to trust the forecast; None where that cannot be
        told: the training data are too few, and no disagreement is larger than in training, or
        there is a single estimator.
    attribution
        Groups of features and by how much each moved the probability, the strongest first; empty
        where not asked for.
    look
        From where to look again, where that is the advice; None where it is not.
    grasp
        The grasp's name: of those that can be chosen, the one with the highest probability.
    grasps
        The forecasts of all grasps that can be chosen, the best first; empty where there is no
        forecast, or the forecaster knows the reference grasp alone.
    """

    attempt: bool
    probability: float | None
    reason: str
    threshold: float | None = None
    guarantee: str | None = None
    p_value: float | None = None
    out_of_distribution: bool | None = False
    attribution: tuple[tuple[str, float], ...] = ()
    look: NextLook | None = None
    grasp: str = REFERENCE_GRASP
    grasps: tuple[GraspForecast, ...] = ()

    @property
    def may_attempt(self) -> bool:
        """Whether there is a threshold at which it is attempted: a forecast that can be trusted."""
        return self.probability is not None and not self.out_of_distribution

    def __str__(self) -> str:
        if self.look is not None:
            return "look again"
        return "attempt" if self.attempt else "abstain"


@dataclass(frozen=True, eq=False)
class VerdictRow:
    """The verdict on one grasp of one instance.

    Attributes
    ----------
    key
        The instance; ``est_id`` is the principal's.
    principal, gripper, grasp
        Who guides which grasp by which gripper.
    verdict
        Attempt or abstain, and why.
    cam_T_obj
        The principal's pose, which would guide the grasp, metres, (4, 4).
    views
        From how many images the forecast is.
    """

    key: InstanceKey
    principal: str
    gripper: str
    verdict: Verdict
    cam_T_obj: Float[ndarray, "4 4"]
    grasp: str = REFERENCE_GRASP
    views: int = 1

    def __repr__(self) -> str:
        return f"VerdictRow({self.key} by {self.principal}, {self.gripper} gripper: {self.verdict})"


@dataclass(frozen=True, eq=False)
class InstanceLooks:
    """The verdicts on one instance after each look.

    Attributes
    ----------
    rows
        After one look, two, and so on: as many as there were images, or were allowed.
    ended
        After how many looks the policy ended.
    """

    rows: tuple[VerdictRow, ...]
    ended: int

    def __repr__(self) -> str:
        looks = counted(len(self.rows), "look")
        return f"InstanceLooks({looks}, ended after {self.ended}: {self.last})"

    @property
    def last(self) -> VerdictRow:
        """The verdict at which looking ended."""
        return self.rows[self.ended - 1]


def check_threshold(threshold: float) -> float:
    """Return a decision threshold, if it is a probability.

    Raises
    ------
    InputError
        If it is not between 0 and 1.
    """
    if not _is_share(threshold):
        raise InputError(f"the threshold is a probability between 0 and 1, not {threshold}")
    return threshold


def decide(
    probability: float,
    threshold: float | None,
    *,
    guarantee: str | None = None,
    disagreement: Disagreement | None = None,
    ood_alpha: float = OOD_ALPHA,
    attribution: tuple[tuple[str, float], ...] = (),
) -> Verdict:
    """Return the verdict: attempt from a probability on, unless out of distribution.

    Parameters
    ----------
    probability
        The probability of success.
    threshold
        The least that is attempted; None attempts nothing.
    guarantee
        What the threshold was certified to keep, or why nothing could be.
    disagreement
        How unusual the estimators' disagreement is; None if not asked for.
    ood_alpha
        A p-value of this or less is out of distribution; 0 accepts every p-value. A disagreement
        larger than in training is always out of distribution.
    attribution
        What moved the probability, and by how much.
    """
    unusual = None if disagreement is None else disagreement.is_novel(ood_alpha)
    p_value = None if disagreement is None else disagreement.p_value
    attempt = threshold is not None and probability >= threshold and not unusual
    if threshold is None:
        reason = f"probability {probability:.3f}; no threshold could be certified"
    else:
        sign = ">=" if probability >= threshold else "<"
        reason = f"probability {probability:.3f} {sign} {threshold:g}"
    if disagreement is not None and unusual:
        why = disagreement.excess or f"p-value {disagreement.p_value:.4f}"
        reason += f"; {_UNUSUAL} ({why})"
    elif disagreement is not None and unusual is None:
        reason += (
            f"; novelty not checkable at level {ood_alpha:g} (smallest p-value "
            f"{disagreement.smallest:.3f})"
        )
    if attribution:
        parts = ", ".join(f"{name} {by:+.2f}" for name, by in attribution[:2])
        reason += f"; attributed to {parts}"
    return Verdict(
        attempt,
        probability,
        reason,
        threshold,
        guarantee,
        p_value,
        False if disagreement is None else unusual,
        tuple(attribution),
    )


_UNUSUAL = "out-of-distribution disagreement"
_COMPARED = re.compile(r"probability [0-9.]+ (?:>=|<) ([0-9.e+-]+)")


def said_by(reason: str) -> tuple[float | None, bool]:
    """Return what a reason of :func:`decide` says.

    Returns
    -------
        The threshold, to six digits, or None; and whether the disagreement was out of distribution.
    """
    found = _COMPARED.match(reason)
    threshold = None
    if found is not None:
        try:
            threshold = float(found.group(1))
        except ValueError:
            threshold = None
    known = threshold is not None and _is_share(threshold)
    return threshold if known else None, _UNUSUAL in reason


def chosen(verdict: Verdict, grasps: tuple[GraspForecast, ...]) -> Verdict:
    """Return a verdict with the grasp that it is about, the first of a ranking."""
    best = grasps[0]
    among = f", the best of {len(grasps)}" if len(grasps) > 1 else ""
    few = " alone" if best.rests_on_few else ""
    said = f"grasp {best.grasp}{among}, by {counted(best.outcomes, 'outcome')}{few}"
    return replace(verdict, reason=f"{verdict.reason}; {said}", grasp=best.grasp, grasps=grasps)


def untrained_rows(
    instances: Instances, cam_T_obj: Float[ndarray, "n 4 4"], *, principal: str, gripper: str
) -> list[VerdictRow]:
    """Return the verdicts on instances of objects that the forecaster was not trained for.

    Parameters
    ----------
    instances, cam_T_obj
        The instances, and the principal's poses of them, metres, (n, 4, 4).
    principal, gripper
        Who would guide grasps by which gripper.
    """
    return [
        VerdictRow(
            key,
            principal,
            gripper,
            Verdict(False, None, f"the model was not trained for {key.object}"),
            pose,
        )
        for key, pose in zip(instances.to_keys(), cam_T_obj, strict=True)
    ]


def verdict_rows(
    estimates: Estimates, verdicts: Iterable[Verdict], *, principal: str, gripper: str
) -> list[VerdictRow]:
    """Return the verdicts on all of the principal's instances, ordered by key.

    Parameters
    ----------
    estimates
        Instances with a pose by every estimator, and those that some lack: these are abstained
        from.
    verdicts
        One for each of the former.
    principal, gripper
        Who guides grasps by which gripper.
    """
    who: dict[str, Any] = {"principal": principal, "gripper": gripper}
    triples = zip(estimates.instances.to_keys(), verdicts, estimates.of(principal), strict=True)
    rows = [
        VerdictRow(key, verdict=given, cam_T_obj=pose, grasp=given.grasp, **who)
        for key, given, pose in triples
    ]
    for gap in estimates.incomplete:
        verdict = Verdict(False, None, gap.reason)
        rows.append(VerdictRow(gap.key, verdict=verdict, cam_T_obj=gap.cam_T_obj, **who))
    return sorted(rows, key=lambda row: row.key)
