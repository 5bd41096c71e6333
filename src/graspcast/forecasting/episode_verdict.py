"""The verdict on one object after a look, and from where to look at one that was not found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.forecasting.grasp_ranking import GraspForecast
from graspcast.forecasting.verdict import Verdict, VerdictRow
from graspcast.pose.transforms import compose, invert
from graspcast.views.look import Look
from graspcast.views.next_look import NextLook, next_look
from graspcast.views.tracks import Track, turned

__all__ = ["EpisodeVerdict", "from_where"]


@dataclass(frozen=True, eq=False)
class EpisodeVerdict:
    """The verdict on one object after a look.

    Attributes
    ----------
    instance
        A number that stays the same from look to look.
    object_name
        ``dataset-obj_id``.
    verdict
        Attempt, look again or abstain; ``str(verdict)`` is one of these.
    guide
        Whose pose guides the grasp: an estimator, or ``fused``; None without a pose.
    cam_T_obj, world_T_obj
        The pose to grasp by, in the camera's frame of this look and in the world, metres, (4, 4).
        None where there is none, or the camera's pose is not known.
    views
        How many looks entered; 0 without a pose.
    looks
        How many looks there were.
    row
        The verdict with the instance's key, as other functions take it; None without a pose.
    notes
        What was left out or is in doubt, in words.
    """

    instance: int
    object_name: str
    verdict: Verdict
    guide: str | None
    cam_T_obj: Float[ndarray, "4 4"] | None
    world_T_obj: Float[ndarray, "4 4"] | None
    views: int
    looks: int
    row: VerdictRow | None = None
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        return str(self.verdict)

    @property
    def attempt(self) -> bool:
        """Whether to attempt the grasp."""
        return self.verdict.attempt

    @property
    def look(self) -> NextLook | None:
        """From where to look again; None where that is not the advice."""
        return self.verdict.look

    @property
    def probability(self) -> float | None:
        """The probability of success; None where there is no forecast."""
        return self.verdict.probability

    @property
    def grasp(self) -> str:
        """The grasp's name (:attr:`Verdict.grasp`)."""
        return self.verdict.grasp

    @property
    def grasps(self) -> tuple[GraspForecast, ...]:
        """The forecasts of all grasps that can be chosen (:attr:`Verdict.grasps`)."""
        return self.verdict.grasps

    @property
    def reason(self) -> str:
        """Why, in a few words, with the notes."""
        return "; ".join((self.verdict.reason, *self.notes))


def from_where(track: Track, looks: Sequence[Look]) -> NextLook | None:
    """Return from where to look at an object that this look did not find; None if unknown."""
    world_T_cam = looks[-1].world_T_cam
    if track.world_T_obj is None or world_T_cam is None:
        return None
    cam_T_world = invert(world_T_cam)
    cameras = [look.world_T_cam for look in looks if look.world_T_cam is not None]
    return next_look(
        compose(cam_T_world, track.world_T_obj),
        turned(track.covariance, cam_T_world[:3, :3]),
        world_T_cam,
        cam_T_view=compose(cam_T_world, np.stack(cameras)),
    )
