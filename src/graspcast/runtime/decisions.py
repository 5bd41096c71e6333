"""Decisions by verdicts: identified, with the poses of object and gripper."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from typing import Any

from jaxtyping import Float
from numpy import ndarray

from graspcast.estimates.outcomes import REFERENCE_GRASP
from graspcast.forecasting.episode_verdict import EpisodeVerdict
from graspcast.pose.transforms import compose
from graspcast.runtime.answer import ABSTAIN, ATTEMPT, LOOK_AGAIN, Action, Decision

__all__ = ["decision_of", "new_id", "without_pose"]


def new_id() -> str:
    """Return 32 hexadecimal digits: milliseconds since 1970, then 80 random bits."""
    return f"{time.time_ns() // 1_000_000:012x}{os.urandom(10).hex()}"


def decision_of(
    verdict: EpisodeVerdict,
    instance: int,
    *,
    gripper: str,
    obj_T_grasp: Mapping[str, Float[ndarray, "4 4"]],
) -> Decision:
    """Return the decision by the verdict on one instance.

    Parameters
    ----------
    verdict
        The verdict.
    instance
        The instance's number in the episode.
    gripper
        The gripper's name.
    obj_T_grasp
        Name of each grasp of the object whose pose is known to that pose, metres.
    """
    given = verdict.verdict
    on_object = obj_T_grasp.get(given.grasp)
    return Decision(
        id=new_id(),
        instance=instance,
        object_name=verdict.object_name,
        action=_action(verdict),
        probability=given.probability,
        threshold=given.threshold,
        guarantee=given.guarantee,
        reason=given.reason,
        guide=verdict.guide,
        cam_T_obj=verdict.cam_T_obj,
        world_T_obj=verdict.world_T_obj,
        gripper=gripper,
        grasp=given.grasp,
        cam_T_grasp=_carried(verdict.cam_T_obj, on_object),
        world_T_grasp=_carried(verdict.world_T_obj, on_object),
        next_look=given.look,
        views=verdict.views,
        looks=verdict.looks,
        notes=verdict.notes,
    )


def without_pose(object_name: str, reason: str, *, gripper: str, looks: int) -> Decision:
    """Return the decision to abstain from an object of which no estimator has a sane pose."""
    nothing: dict[str, Any] = dict.fromkeys(
        ("probability", "threshold", "guarantee", "guide", "cam_T_obj", "world_T_obj")
    )
    return Decision(
        id=new_id(),
        instance=-1,
        object_name=object_name,
        action=ABSTAIN,
        reason=reason,
        gripper=gripper,
        grasp=REFERENCE_GRASP,
        cam_T_grasp=None,
        world_T_grasp=None,
        next_look=None,
        views=0,
        looks=looks,
        **nothing,
    )


def _action(verdict: EpisodeVerdict) -> Action:
    if verdict.look is not None:
        return LOOK_AGAIN
    return ATTEMPT if verdict.attempt else ABSTAIN


def _carried(
    pose: Float[ndarray, "4 4"] | None, on_object: Float[ndarray, "4 4"] | None
) -> Float[ndarray, "4 4"] | None:
    return None if pose is None or on_object is None else compose(pose, on_object)
