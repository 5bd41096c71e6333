"""Frames of grasp poses from elsewhere: what is stated is checked by simulation at the true pose.

Programs differ in what a grasp pose is the pose of, in which of its axes the fingers close, and in
the unit. A wrong reading shows: the hand does not touch the object, or presses into it. Then other
readings are tried, and the one that fits is named; nothing is converted silently.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError, MismatchError
from graspcast.io.wording import counted
from graspcast.pose.transforms import invert
from graspcast.simulation.grasps.trial_pool import TrialPool
from graspcast.simulation.grippers.protocol import Gripper

__all__ = ["FRAMES", "Frame", "PoseFrame", "check_pose_frame"]

Frame = Literal["tcp", "base", "graspgen"]
FRAMES: tuple[Frame, ...] = ("tcp", "base", "graspgen")

_WORDS = {
    "tcp": "the tool centre point",
    "base": "the gripper's base frame",
    "graspgen": "GraspGen's frame (the base's origin, z along the approach, x along the closing)",
}
_MOST_TRIED = 24
_ENOUGH = 0.2


@dataclass(frozen=True)
class PoseFrame:
    """What a grasp pose in a file is the pose of.

    Attributes
    ----------
    frame
        ``tcp``: the gripper's tool centre point. ``base``: its base, with the axes of its model.
        ``graspgen``: the base's origin, with the axes of the tool centre point.
    closing
        Axis of the pose along which the fingers close; left at ``x`` for ``base``, whose axes are
        the model's.
    unit
        Unit of positions, ``m`` or ``mm``.
    backwards
        Whether z points back from the object to the palm.
    inverted
        Whether the poses are those of the object in the hand's frame.

    Raises
    ------
    InputError
        If a closing axis is given for ``base``.
    """

    frame: Frame = "tcp"
    closing: Literal["x", "y"] = "x"
    unit: Literal["m", "mm"] = "m"
    backwards: bool = False
    inverted: bool = False

    def __post_init__(self) -> None:
        if self.frame == "base" and self.closing != "x":
            raise InputError(
                "the fingers close as the gripper's model has it, where poses are of its base; "
                "leave out the closing axis",
                parameters=("frame", "closing"),
            )

    def obj_T_grasp(
        self, poses: Float[ndarray, "n 4 4"], gripper: Gripper
    ) -> Float[ndarray, "n 4 4"]:
        """Convert poses of a file to grasps, metres."""
        out = poses.copy()
        out[:, :3, 3] *= 1e-3 if self.unit == "mm" else 1.0
        if self.inverted:
            out = invert(out)
        if self.backwards:
            out = out @ np.diag([1.0, -1.0, -1.0, 1.0])
        if self.closing == "y":
            quarter = np.eye(4)
            quarter[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
            out = out @ quarter
        base_T_tcp = gripper.base_T_tcp
        if self.frame == "base":
            return np.asarray(out @ base_T_tcp)
        if self.frame == "graspgen":
            forward = np.eye(4)
            forward[:3, 3] = base_T_tcp[:3, :3].T @ base_T_tcp[:3, 3]
            return np.asarray(out @ forward)
        return out

    def words(self) -> str:
        """Say the reading in words."""
        text = f"poses of {_WORDS[self.frame]} in {'milli' * (self.unit == 'mm')}metres"
        if self.closing == "y":
            text += ", closing along y"
        if self.backwards:
            text += ", with z pointing back to the palm"
        if self.inverted:
            text += ", of the object in the hand's frame instead (inverted)"
        return text


def check_pose_frame(
    pool: TrialPool, poses: Float[ndarray, "n 4 4"], stated: PoseFrame
) -> tuple[int, int]:
    """Check by trials at the true pose that poses are in the stated frame.

    Parameters
    ----------
    pool
        Trials of the object by the gripper.
    poses
        Poses as the file has them; at most 24, spread over the file, are tried.
    stated
        The frame that they are said to be in.

    Returns
    -------
        How many hold, and how many were tried.

    Raises
    ------
    MismatchError
        If fewer than a fifth hold, and at least twice as many do in another frame, which is named;
        or if none even touches the object.
    """
    few = poses[np.unique(np.linspace(0, len(poses) - 1, _MOST_TRIED).round().astype(int))]
    fits = _unit_fits(few, stated.unit)
    # In too small a unit all grasps are at the object's origin, which may well be held.
    reasons = _tried(pool, few, stated) if fits else Counter[str]()
    held = reasons["held"]
    if held >= _ENOUGH * len(few):
        return held, len(few)
    best, most = stated, held
    for other in _others(stated):
        if not _unit_fits(few, other.unit):
            continue
        found = _tried(pool, few, other)["held"]
        if found > most:
            best, most = other, found
    tried = counted(len(few), "grasp")
    if best != stated and most >= max(2 * held + 1, _ENOUGH * len(few)):
        what = "touches" if not _touching(reasons) else "holds"
        how = f"only {held} of {tried}" if held else f"none of {tried}"
        raise MismatchError(
            f"read as {stated.words()}, {how} {what} the object at its true pose; read as "
            f"{best.words()}, {most} hold" + _convert(stated, best),
            parameters=_to_say(stated, best),
        )
    if not _touching(reasons):
        raise MismatchError(
            f"none of {tried} touches the object at its true pose, read as {stated.words()} or in "
            "any of the other usual ways; are they of this object's mesh, in its frame and size?",
            parameters=("frame",),
        )
    return held, len(few)


def _unit_fits(poses: Float[ndarray, "n 4 4"], unit: str) -> bool:
    """Return whether hands are near the object's origin, but not all at it, in a unit."""
    away = float(np.median(np.linalg.norm(poses[:, :3, 3], axis=1)))
    return away > 1.0 if unit == "mm" else away <= 1.0


def _tried(pool: TrialPool, poses: ndarray, frame: PoseFrame) -> Counter[str]:
    grasps = frame.obj_T_grasp(poses, pool.gripper)
    outcomes = pool.run([(np.eye(4), grasp) for grasp in grasps])
    return Counter(
        "touched the table"
        if outcome.reason == "collided" and outcome.hit == "table"
        else outcome.reason
        for outcome in outcomes
    )


def _touching(reasons: Counter[str]) -> int:
    return sum(reasons[reason] for reason in ("held", "dropped", "slipped", "collided", "blocked"))


def _others(stated: PoseFrame) -> list[PoseFrame]:
    """Return the other readings, those that differ in fewest points first."""
    found = [
        PoseFrame(frame, closing, unit, backwards, inverted)  # type: ignore[arg-type]
        for frame, closing, unit, backwards, inverted in product(
            FRAMES, ("x", "y"), ("m", "mm"), (False, True), (False, True)
        )
        if frame != "base" or (closing == "x" and not backwards)
    ]
    different = [frame for frame in found if frame != stated]
    return sorted(different, key=lambda frame: len(_differences(stated, frame)))


def _differences(one: PoseFrame, other: PoseFrame) -> Sequence[str]:
    names = ("frame", "closing", "unit", "backwards", "inverted")
    return [name for name in names if getattr(one, name) != getattr(other, name)]


def _to_say(stated: PoseFrame, best: PoseFrame) -> tuple[str, ...]:
    return tuple(
        name for name in _differences(stated, best) if name in ("frame", "closing", "unit")
    )


def _convert(stated: PoseFrame, best: PoseFrame) -> str:
    """Say what must be done to poses that no option describes."""
    if not (best.backwards or best.inverted):
        return f": say so, if that is what they are ({_terms(stated, best)})"
    return "; convert them and write them to another file"


def _terms(stated: PoseFrame, best: PoseFrame) -> str:
    return ", ".join(f"{name} {getattr(best, name)}" for name in _to_say(stated, best))
