"""When the outcome of a trial is certain before its lift is over.

Two things end a trial early, and nothing else: the object stays behind where the rising hand
cannot come to it any more, or it hangs in the hand so still that what is left of the lift cannot
carry it across the tolerance.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.simulation.trial.scene import Scene, Touch

__all__ = ["Steadiness", "beyond_reach", "left_behind_m"]

_AT_REST = 2e-3
_CLEARANCE_M = 0.01
_STEADY_AFTER_S, _STEADY_WINDOW_S = 0.6, 0.3
_EXTRAPOLATE, _TURN_RAD, _POSTURE_M, _SHIFT_M = 2.0, 0.25, 5e-3, 2e-3


def beyond_reach(scene: Scene, start: Float[ndarray, " 3"], end: Float[ndarray, " 3"]) -> bool:
    """Whether a hand whose base goes from ``start`` to ``end`` and up can never touch the object.

    True if seen from above the hand's path is farther from the object than both reach, or if the
    whole path is above it by as much.
    """
    reach = scene.hand_reach_m + scene.object_radius_m + _CLEARANCE_M
    centre = scene.data.xipos[scene.object_body]
    along = end[:2] - start[:2]
    length = float(along @ along)
    nearest = np.clip((centre[:2] - start[:2]) @ along / length, 0.0, 1.0) if length > 0 else 0.0
    sideways = float(np.linalg.norm(centre[:2] - start[:2] - nearest * along))
    return bool(sideways > reach or min(start[2], end[2]) - centre[2] > reach)


def left_behind_m(
    scene: Scene, offset_at_grasp: Float[ndarray, " 3"], remaining_m: float
) -> float | None:
    """How far from the hand the object will be, if it certainly stays behind; else None.

    To be asked of a closed hand that does not touch the object. As it only moves up, it cannot
    come to an object that lies still on the table and has none of the hand's parts under any of its
    own, nor to one that is wholly below the hand and has not the energy to rise to it. All this
    with a margin, wider by as far as fingers still on their way could go in a second.
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
        if speed + spin > _AT_REST or not scene.touch().table_object:
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


class Steadiness:
    """Watches an object in the hand during the lift, and says when it will stay as it is."""

    def __init__(self, scene: Scene, offset_at_grasp: Float[ndarray, " 3"]):
        self._scene = scene
        self._reference = offset_at_grasp
        self._seen: deque[_Seen] = deque()

    def certain(self, lifted_s: float, touch: Touch) -> bool:
        """Whether the offset will certainly be on the same side of the tolerance at the end.

        To be asked at regular times. The object must be held clear of the table, and the motion
        over the last 0.3 s, at twice its rate until the end of the lift, must keep the offset on
        the same side of the tolerance, the object within 2 mm and 15 degrees of where it is, and
        the fingers within 5 mm: a grip that gives way slowly lets go at once, wherever it comes to
        an edge.
        """
        scene = self._scene
        if not touch.hand_object or touch.table_object:
            self._seen.clear()
            return False
        now = self._look(lifted_s)
        self._seen.append(now)
        while lifted_s - self._seen[0].time > _STEADY_WINDOW_S + 1e-9:
            self._seen.popleft()
        window = lifted_s - self._seen[0].time
        if lifted_s < _STEADY_AFTER_S or window < _STEADY_WINDOW_S - 1e-9:
            return False
        if scene.object_boxes()[0][:, 2].min() < _CLEARANCE_M:
            return False
        ahead = _EXTRAPOLATE * (scene.settings.lift_s - lifted_s) / window
        before = list(self._seen)
        shift = ahead * np.linalg.norm(now.offset - [s.offset for s in before], axis=1).max()
        # The chord of a small rotation: |R - R'| = sqrt(8) sin(angle / 2).
        chords = np.linalg.norm(now.turn - [s.turn for s in before], axis=(1, 2))
        angle = ahead * chords.max() / np.sqrt(2.0)
        joint = ahead * np.abs(now.joints - [s.joints for s in before]).max()
        margin = abs(float(np.linalg.norm(now.offset)) - scene.settings.tolerance_m)
        return bool(shift < min(_SHIFT_M, margin) and joint < _POSTURE_M and angle < _TURN_RAD)

    def _look(self, lifted_s: float) -> _Seen:
        scene = self._scene
        base = scene.data.xmat[scene.base_body].reshape(3, 3)
        return _Seen(
            lifted_s,
            scene.centroid_in_base() - self._reference,
            base.T @ scene.data.xmat[scene.object_body].reshape(3, 3),
            scene.posture(),
        )


class _Seen(NamedTuple):
    time: float
    offset: Float[ndarray, " 3"]
    turn: Float[ndarray, "3 3"]
    joints: Float[ndarray, " j"]
