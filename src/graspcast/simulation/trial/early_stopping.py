"""Early stopping of a trial: end the lift as soon as its outcome can no longer change.

A trial is stopped early in three cases: the hand's path never comes near the object; the object
stays behind where the rising hand cannot reach it; or the object hangs in the hand so still, or
comes to rest in it so fast, that the rest of the lift cannot carry it across the tolerance.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.simulation.trial.scene import Contacts, Scene

__all__ = ["CHECK_S", "RULES", "HoldMonitor", "above_table", "left_behind_offset_m", "out_of_reach"]

CHECK_S = 0.04
"""Time between two checks during the lift, seconds."""

RULES = 2
"""Version of these rules; it is part of the digest of trials that they stop."""

_AT_REST = 2e-3
_CLEARANCE_M = 0.01
_INTERVALS = 2
_EXTRAPOLATE, _TURN_RAD, _POSTURE_M, _SHIFT_M = 2.0, 0.25, 5e-3, 2e-3
_FADING, _FADING_MARGIN, _NO_CREEP_IMPRATIO = 0.8, 4.0, 1000.0


def out_of_reach(scene: Scene, start: Float[ndarray, " 3"], end: Float[ndarray, " 3"]) -> bool:
    """Return whether the hand can never touch the object on its path.

    The hand's base moves from ``start`` to ``end`` (world frame, metres) and then up. The object is
    out of reach if, seen from above, the path passes it at more than the hand's reach plus the
    object's radius, or if the whole path is above it by as much.
    """
    reach = scene.hand_reach_m + scene.object_radius_m + _CLEARANCE_M
    centre = scene.data.xipos[scene.object_body]
    along = end[:2] - start[:2]
    length = float(along @ along)
    nearest = np.clip((centre[:2] - start[:2]) @ along / length, 0.0, 1.0) if length > 0 else 0.0
    sideways = float(np.linalg.norm(centre[:2] - start[:2] - nearest * along))
    return bool(sideways > reach or min(start[2], end[2]) - centre[2] > reach)


def above_table(scene: Scene, start: Float[ndarray, " 3"], end: Float[ndarray, " 3"]) -> bool:
    """Return whether the hand can never touch the table on its path from ``start`` to ``end``."""
    lowest = min(start[2], end[2]) - scene.hand_reach_m - _CLEARANCE_M
    return bool(lowest > 0.0) or not scene.settings.hand_touches_table


def left_behind_offset_m(
    scene: Scene, offset_at_grasp: Float[ndarray, " 3"], remaining_m: float
) -> float | None:
    """Return the final offset of an object that stays behind, or None if it might be picked up.

    Call it for a closed hand that does not touch the object. The hand only moves up, so it cannot
    reach an object that lies still on the table with no part of the hand under any part of it, nor
    one that is wholly below the hand and has too little energy to rise to it. The margin grows with
    the distance that fingers still in motion could travel in a second.

    Parameters
    ----------
    scene
        The current state.
    offset_at_grasp
        Object's centroid in the hand's base frame after closing, metres.
    remaining_m
        Height that is left of the lift, metres.
    """
    data = scene.data
    margin = _CLEARANCE_M + 2.0 * scene.hand_speed()
    velocity, centre = data.qvel[:6], scene.model.body_ipos[scene.object_body]
    turning = float(np.linalg.norm(velocity[3:]))
    speed = float(np.linalg.norm(velocity[:3]) + turning * np.linalg.norm(centre))
    spin = turning * scene.object_radius_m
    rise = (speed**2 + spin**2) / (2.0 * 9.81)
    hand_low, hand_high = scene.hand_boxes()
    top = data.xipos[scene.object_body][2] + scene.object_radius_m + rise
    if top + margin > hand_low[:, 2].min():
        if speed + spin > _AT_REST or not scene.contacts().table_object:
            return None
        low, high = scene.object_boxes()
        over = np.all(
            (hand_low[:, None, :2] < high[None, :, :2] + margin)
            & (hand_high[:, None, :2] > low[None, :, :2] - margin),
            axis=2,
        )
        if np.any(over & (hand_low[:, None, 2] < high[None, :, 2])):
            return None
    base = data.xmat[scene.base_body].reshape(3, 3)
    moved = base @ (scene.centroid_in_base() - offset_at_grasp)
    moved[2] += rise - remaining_m
    final = float(np.linalg.norm(moved))
    return final if -moved[2] > scene.settings.tolerance_m + _CLEARANCE_M else None


class HoldMonitor:
    """Decides during the lift whether an object in the hand will stay as it is.

    Parameters
    ----------
    scene
        The scene of the trial.
    offset_at_grasp
        Object's centroid in the hand's base frame after closing, metres.
    """

    def __init__(self, scene: Scene, offset_at_grasp: Float[ndarray, " 3"]):
        self._scene = scene
        self._reference = offset_at_grasp
        self._samples: deque[_Sample] = deque(maxlen=2 * _INTERVALS + 1)
        # Friction creeps at a constant rate where its impedance is low.
        self._creeps = scene.settings.impratio < _NO_CREEP_IMPRATIO

    def should_stop(self, lifted_s: float, contacts: Contacts, *, pressing: bool) -> bool:
        """Record the current state and return whether the trial can be stopped.

        Call it every ``CHECK_S``. The object must be held clear of the table. Its motion in the
        hand over the last 0.08 s is extrapolated to the end of the lift, at twice its rate; or, if
        it is less than 0.8 of that in the 0.08 s before, as a geometric series, four times its sum.
        That must keep the offset on the same side of the tolerance, the object within 2 mm and 15
        degrees of its current pose, and the fingers within 5 mm: a grip that gives way slowly lets
        go at once where it reaches an edge.

        Parameters
        ----------
        lifted_s
            Time since the start of the lift, seconds.
        contacts
            Contacts of the current state.
        pressing
            Whether the hand is as closed, or presses as hard, as it will.
        """
        scene, settings = self._scene, self._scene.settings
        if not pressing or not contacts.hand_object or contacts.table_object:
            self._samples.clear()
            return False
        self._samples.append(self._sample())
        window = _INTERVALS * CHECK_S
        if len(self._samples) <= 2 * _INTERVALS or lifted_s < settings.lift_ramp_s + CHECK_S:
            return False
        left = (settings.lift_s - lifted_s) / window
        margin = abs(float(np.linalg.norm(self._samples[-1].offset)) - settings.tolerance_m)
        # The chord of a small rotation: |R - R'| = sqrt(2) * angle.
        limits = (_POSTURE_M, min(_SHIFT_M, margin), _TURN_RAD * np.sqrt(2.0))
        motions = (np.array(values) for values in zip(*self._samples, strict=True))
        for values, limit in zip(motions, limits, strict=True):
            if not self._remaining(values, left) < limit:
                return False
        return bool(scene.object_boxes()[0][:, 2].min() >= _CLEARANCE_M)

    def _remaining(self, values: Float[ndarray, "s v"], left: float) -> float:
        """Return a bound on the motion in ``left`` further windows."""
        before, now = (
            float(np.sqrt(np.square(part[:-1] - part[-1]).sum(axis=1).max()))
            for part in (values[: _INTERVALS + 1], values[_INTERVALS:])
        )
        if not self._creeps and now < _FADING * before:
            return min(_EXTRAPOLATE * left * now, _FADING_MARGIN * now * now / (before - now))
        return _EXTRAPOLATE * left * now

    def _sample(self) -> _Sample:
        scene = self._scene
        base = scene.data.xmat[scene.base_body].reshape(3, 3)
        return _Sample(
            scene.posture(),
            scene.centroid_in_base() - self._reference,
            (base.T @ scene.data.xmat[scene.object_body].reshape(3, 3)).ravel(),
        )


class _Sample(NamedTuple):
    """State of hand and object at one time."""

    joints: Float[ndarray, " j"]
    offset: Float[ndarray, " 3"]
    rotation: Float[ndarray, " 9"]
