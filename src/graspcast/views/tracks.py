"""Tracks: the same number for the same instance from look to look, by geometry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.estimates.instances import split_object_name
from graspcast.views.association import associate, pair_distances
from graspcast.views.fused_estimates import FusedEstimates
from graspcast.views.fusion import CONTRADICTION

__all__ = ["Track", "Tracks", "turned"]

_ALONE = np.eye(4)[None]
_DOUBT = "it is not sure which of several instances this is; it has a new number"


@dataclass(frozen=True, eq=False)
class Track:
    """An instance as it was last seen.

    Attributes
    ----------
    number
        Its number.
    world_T_obj
        Its fused pose; None where the camera's pose was not known.
    covariance
        Of position and rotation vector in the world's axes, (6, 6).
    """

    number: int
    world_T_obj: Float[ndarray, "4 4"] | None
    covariance: Float[ndarray, "6 6"]


class Tracks:
    """The instances of one scene that were seen so far.

    An instance has the number of the track whose pose agrees with its own within both
    uncertainties, one to one. Where another assignment is as plausible it has a new number, and
    this is said. A single instance of an object that always was single keeps its number, wherever
    it is.
    """

    def __init__(self) -> None:
        self._of: dict[str, list[Track]] = {}
        self._next = 0

    def of(self, object_name: str) -> list[Track]:
        """Return the tracks of an object."""
        return list(self._of.get(object_name, []))

    def copy(self) -> Tracks:
        """Return tracks that may go on without these."""
        out = Tracks()
        out._of, out._next = {name: list(some) for name, some in self._of.items()}, self._next
        return out

    def follow(
        self,
        fused: FusedEstimates,
        world_T_cam: Float[ndarray, "4 4"] | None,
        models: Mapping[str, Models] | None = None,
    ) -> tuple[list[int], list[str]]:
        """Give a number to each instance of a further look, and remember where it is.

        Parameters
        ----------
        fused
            All instances of their objects in the look.
        world_T_cam
            The camera's pose in the world, if it is known.
        models
            Dataset's name to its object models, for symmetries.

        Returns
        -------
        A number for each instance; and why it is a new one in spite of others, or nothing.
        """
        numbers, said = [-1] * len(fused), [""] * len(fused)
        objects = fused.instances.objects
        for name in dict.fromkeys(objects.tolist()):
            rows = np.flatnonzero(objects == name).tolist()
            now = [_seen(fused, i, world_T_cam) for i in rows]
            before = self._of.get(name, [])
            if len(now) != 1 or len(before) != 1:
                before = [track for track in before if track.world_T_obj is not None]
            which, doubted, near = _matched(now, before, _symmetries(name, models))
            if self.of(name) and not before:  # where those were is not known
                doubted = [True] * len(now)
            gone = {j for doubt, some in zip(doubted, near, strict=True) if doubt for j in some}
            kept = [t for j, t in enumerate(before) if j not in which and j not in gone]
            for i, track, j, doubt in zip(rows, now, which, doubted, strict=True):
                numbers[i] = before[j].number if j >= 0 else self._next
                self._next += int(j < 0)
                kept.append(replace(track, number=numbers[i]))
                said[i] = _DOUBT if doubt else ""
            self._of[name] = kept
        return numbers, said


def turned(covariance: Float[ndarray, "6 6"], R: Float[ndarray, "3 3"]) -> Float[ndarray, "6 6"]:
    """Return the covariance of position and rotation vector in other axes."""
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = R
    out: ndarray = turn @ covariance @ turn.T
    return out


def _seen(fused: FusedEstimates, i: int, world_T_cam: Float[ndarray, "4 4"] | None) -> Track:
    pose, covariance = fused.poses.cam_T_obj[i], fused.poses.covariance[i]
    if world_T_cam is None:
        return Track(-1, None, covariance)
    return Track(-1, world_T_cam @ pose, turned(covariance, world_T_cam[:3, :3]))


def _symmetries(name: str, models: Mapping[str, Models] | None) -> Float[ndarray, "s 4 4"]:
    dataset, obj_id = split_object_name(name)
    info = models[dataset].info if models and dataset in models else {}
    return info[obj_id].symmetries if obj_id in info else _ALONE


def _matched(
    now: Sequence[Track], before: Sequence[Track], symmetries: Float[ndarray, "s 4 4"]
) -> tuple[list[int], list[bool], list[set[int]]]:
    """Return each instance's track (-1 for none), whether it is doubted, and the tracks near."""
    if not before:
        return [-1] * len(now), [False] * len(now), [set() for _ in now]
    if len(now) == len(before) == 1:
        return [0], [False], [{0}]
    if any(track.world_T_obj is None for track in now):
        return [-1] * len(now), [True] * len(now), [set() for _ in now]
    first, second = (
        (np.array([t.world_T_obj for t in some]), np.array([t.covariance[:3, :3] for t in some]))
        for some in (now, before)
    )
    turns = [np.trace(t.covariance[3:, 3:]) / 3 for t in (*now, *before)]
    angle = float(np.sqrt(np.mean(turns)))
    sides = {"a": first, "b": second}
    between, of_first, of_second = (
        pair_distances(*sides[i], *sides[j], angle, symmetries) for i, j in ("ab", "aa", "bb")
    )
    which, doubted = associate(between, of_first, of_second)
    near = [set(np.flatnonzero(row <= CONTRADICTION).tolist()) for row in between]
    return which.tolist(), doubted.tolist(), near
