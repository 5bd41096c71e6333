"""Transform buffer: how frames lay to one another at a time, from the messages of tf."""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Iterable
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import TransformMissingError, TransformNotYetError
from graspcast.pose.transforms import compose, invert, rotation_from_vector, rotation_vector
from graspcast.ros.poses import (
    PoseMessageError,
    Stamp,
    frame_name,
    matrix_of,
    seconds,
    stamp_of,
)
from graspcast.ros.problems import Problems

__all__ = ["TransformBuffer"]

Matrix = Float[ndarray, "4 4"]


class _Moving:
    """A frame's poses in its parent over time."""

    def __init__(self, parent: str):
        self.parent = parent
        self.stamps: list[Stamp] = []
        self.poses: dict[Stamp, Matrix] = {}

    def add(self, stamp: Stamp, pose: Matrix, keep_ns: int) -> bool:
        """Add a pose; say whether it was new enough to be kept."""
        if self.stamps and stamp < self.stamps[-1] - keep_ns:
            return False
        if stamp not in self.poses:
            insort(self.stamps, stamp)
        self.poses[stamp] = pose
        first = bisect_left(self.stamps, self.stamps[-1] - keep_ns)
        for old in self.stamps[:first]:
            del self.poses[old]
        del self.stamps[:first]
        return True


class TransformBuffer:
    """Frames and their transforms over time.

    Between two stamps the position is interpolated linearly and the rotation along the shortest
    arc. Nothing is extrapolated: before the first stamp and after the last there is no transform.

    Parameters
    ----------
    keep_s
        How long the transforms of a moving frame are kept, seconds.
    max_gap_s
        Between stamps that lie farther apart nothing is interpolated.

    Attributes
    ----------
    problems
        Transforms that were left out, counted.
    """

    def __init__(self, *, keep_s: float = 30.0, max_gap_s: float = 1.0):
        self._keep_ns, self._max_gap_ns = int(keep_s * 1e9), int(max_gap_s * 1e9)
        self._static: dict[str, tuple[str, Matrix]] = {}
        self._moving: dict[str, _Moving] = {}
        self.problems = Problems()

    def clear(self) -> None:
        """Forget the frames that move, as when a clock was set back; static frames stay."""
        self._moving.clear()

    def add_all(self, transforms: Iterable[Any], *, static: bool = False) -> None:
        """Add the ``TransformStamped`` of a ``TFMessage``; what is no transform is counted."""
        for message in transforms:
            parent = frame_name(message.header.frame_id)
            child = frame_name(message.child_frame_id)
            of = f"{child or '(no name)'} in {parent or '(no name)'}"
            if not parent or not child or parent == child:
                self.problems.add("transform without two frames", of)
                continue
            transform = message.transform
            try:
                pose = matrix_of(transform.translation, transform.rotation)
            except PoseMessageError as error:
                self.problems.add(f"transform with {error}", of)
                continue
            self._add(parent, child, stamp_of(message.header), pose, static)

    def _add(self, parent: str, child: str, stamp: Stamp, pose: Matrix, static: bool) -> None:
        of = f"{child} in {parent}"
        known = self._static.get(child, (None,))[0]
        moving = self._moving.get(child)
        before = known or (moving.parent if moving else parent)
        if before != parent:
            self.problems.add("transform that gives a frame another parent", f"{of}, not {before}")
        if static:
            self._static[child] = parent, pose
            self._moving.pop(child, None)
            return
        if known:
            self.problems.add("moving transform of a static frame", of)
            return
        if moving is None or moving.parent != parent:
            moving = self._moving[child] = _Moving(parent)
        if not moving.add(stamp, pose, self._keep_ns):
            self.problems.add("transform that is older than those kept", of)

    def frames(self) -> list[str]:
        """Return all known frames, by name."""
        named = {*self._static, *self._moving, *(parent for parent, _ in self._static.values())}
        return sorted(named | {moving.parent for moving in self._moving.values()})

    def lookup(self, target: str, source: str, stamp: Stamp) -> Matrix:
        """Return ``target_T_source`` at a time.

        Raises
        ------
        TransformNotYetError
            If it may be known later.
        TransformMissingError
            If it will not be: for times before the first transform, gaps and loops.
        """
        target, source = frame_name(target), frame_name(source)
        if target == source:
            return np.eye(4)
        up, across = self._to_root(target), self._to_root(source)
        common = next((frame for frame in across if frame in up), None)
        if common is None:
            missing = [frame for frame in (target, source) if frame not in self.frames()]
            known = ", ".join(self.frames()) or "none"
            what = f"the frame {missing[0]!r} is unknown" if missing else "they are not connected"
            raise TransformNotYetError(
                f"no transform from {source!r} to {target!r}: {what}; frames known: {known}"
            )
        common_T_target = self._climb(target, common, stamp)
        return compose(invert(common_T_target), self._climb(source, common, stamp))

    def _parent(self, frame: str) -> str | None:
        if frame in self._static:
            return self._static[frame][0]
        return self._moving[frame].parent if frame in self._moving else None

    def _to_root(self, frame: str) -> list[str]:
        chain = [frame]
        while (parent := self._parent(chain[-1])) is not None:
            if parent in chain:
                loop = " in ".join([*chain, parent])
                raise TransformMissingError(f"the transforms form a loop: {loop}")
            chain.append(parent)
        return chain

    def _climb(self, frame: str, ancestor: str, stamp: Stamp) -> Matrix:
        pose: Matrix = np.eye(4)
        while frame != ancestor:
            if frame in self._static:
                parent, step = self._static[frame]
            else:
                moving = self._moving[frame]
                parent, step = moving.parent, self._at(frame, moving, stamp)
            pose = compose(step, pose)
            frame = parent
        return pose

    def _at(self, frame: str, moving: _Moving, stamp: Stamp) -> Matrix:
        """Return a frame's pose in its parent at a time."""
        stamps = moving.stamps
        after = bisect_left(stamps, stamp)
        if after < len(stamps) and stamps[after] == stamp:
            return moving.poses[stamp]
        of = f"of {frame!r} in {moving.parent!r}"
        if after == len(stamps):
            late = seconds(stamp - stamps[-1])
            raise TransformNotYetError(f"the latest transform {of} is {late:.3f} s too old")
        if after == 0:
            early = seconds(stamps[0] - stamp)
            raise TransformMissingError(f"the first transform {of} is {early:.3f} s too late")
        first, second = stamps[after - 1], stamps[after]
        if (gap := second - first) > self._max_gap_ns:
            raise TransformMissingError(
                f"the transforms {of} about this time are {seconds(gap):.3f} s apart, and over at "
                f"most {seconds(self._max_gap_ns):g} s they are interpolated"
            )
        return _between(moving.poses[first], moving.poses[second], (stamp - first) / gap)


def _between(first: Matrix, second: Matrix, share: float) -> Matrix:
    """Interpolate between two poses: the position linearly, the rotation along an arc."""
    out = np.eye(4)
    turn = rotation_vector(first[:3, :3].T @ second[:3, :3])
    out[:3, :3] = first[:3, :3] @ rotation_from_vector(share * turn)
    out[:3, 3] = (1 - share) * first[:3, 3] + share * second[:3, 3]
    return out
