"""Why no grasp was found: what the proposals failed by, in words."""

from __future__ import annotations

import math
from collections import Counter

from graspcast.io.wording import counted
from graspcast.pose.lengths import shown
from graspcast.simulation.grasps.candidates import MARGIN_M, Candidates
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.objects.types import GraspObject

__all__ = ["why_no_grasp"]

_ON_THE_WAY = {
    "object": "the open hand meets the object on its way in",
    "table": "the table is in the way",
    "too wide": "too wide",
    "too slippery": "too slippery: the surfaces are too oblique for the friction",
}
_IN_TRIALS = {
    "dropped": "let the object fall",
    "slipped": "let it slip",
    "missed": "missed it",
    "collided": "pressed against object or table on the way in",
    "blocked": "started in object or table",
    "unstable": "were unstable",
}


def why_no_grasp(
    grasp_object: GraspObject, gripper: Gripper, candidates: Candidates, tried: Counter[str]
) -> str:
    """Say why there is no grasp of an object by a gripper.

    Parameters
    ----------
    grasp_object, gripper
        The two.
    candidates
        The proposals, and why those were left out that could not be tried.
    tried
        Reasons of the outcomes at the true pose of those that were.
    """
    who = f"no grasp of {grasp_object.name!r} by {gripper.name!r} was found: "
    opening = gripper.max_opening_m - 2 * MARGIN_M
    rejected = candidates.rejected
    counts = ", ".join(
        f"{rejected[reason]} {text}" for reason, text in _ON_THE_WAY.items() if rejected[reason]
    )
    wide = candidates.narrowest_m
    outcomes = ", ".join(
        f"{number} {_IN_TRIALS[reason]}" for reason, number in tried.most_common() if number
    )
    total = sum(tried.values())
    if wide > opening:
        cornered = f"; {counted(total, 'grasp')} at corners failed: {outcomes}" if total else ""
        return (
            f"{who}it is {shown(wide)} wide in its narrowest direction, too wide by "
            f"{1e3 * (wide - opening):.1f} mm for an opening of {shown(gripper.max_opening_m)} "
            f"with 1 mm of play on each side ({counts}{cornered})"
        )
    if not len(candidates):
        return f"{who}{_before_trials(grasp_object, candidates, counts)}"
    remedy = ""
    if tried["dropped"] + tried["slipped"] > total / 2:
        remedy = (
            f". With a friction of {grasp_object.friction:g} and {grasp_object.mass_kg:.3g} kg the "
            "object is too slippery or too heavy for this hand"
        )
    return (
        f"{who}none of {counted(total, 'grasp')} whose approach is clear holds the object at its "
        f"true pose: {outcomes}{remedy}. Left out before: {counts or 'none'}"
    )


def _before_trials(grasp_object: GraspObject, candidates: Candidates, counts: str) -> str:
    """Say why no proposal could be tried."""
    rejected = candidates.rejected
    if math.isnan(candidates.narrowest_m) or not (rejected["object"] or rejected["table"]):
        return (
            f"it is too slippery: with a friction of {grasp_object.friction:g} no two of its "
            f"surfaces face one another enough to be gripped ({counts})"
        )
    most = "object" if rejected["object"] > rejected["table"] else "table"
    return (
        f"{_ON_THE_WAY[most]} of each of the proposals that fit between the fingers ({counts}). "
        "Another reference pose (up) or another gripper may leave room"
    )
