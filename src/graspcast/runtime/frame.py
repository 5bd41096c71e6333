"""Frames: all that the estimators found in one image, in memory, checked where it comes in."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.results import Results
from graspcast.errors import InputError
from graspcast.estimates.instances import split_object_name
from graspcast.io.arguments import a, mapping, number, refuse_unless, sequence
from graspcast.io.cached import cached_property
from graspcast.io.wording import counted
from graspcast.pose.sanity import as_pose, is_placeholder
from graspcast.views.look import camera_pose, intrinsics

__all__ = ["MAX_ESTIMATES", "MAX_ESTIMATORS", "Estimate", "Frame"]

MAX_ESTIMATES = 1000
"""The most estimates that a frame may hold, of all estimators together."""
MAX_ESTIMATORS = 32
"""The most estimators that a frame may name."""

_LONGEST_NAME = 200
_FINITE = number(-1e12, 1e12)
_NAMES = sequence(a(str))


@dataclass(frozen=True, eq=False)
class Estimate:
    """One estimator's pose of one instance.

    Attributes
    ----------
    object_name
        ``dataset-obj_id``, as in ``ycbv-5``.
    cam_T_obj
        The pose in the camera's frame (OpenCV's: x right, y down, z forward), metres, (4, 4).
        Whether it can be one is judged later: a pose that cannot, for example with NaN in it, is
        never attempted, and spoils no other.
    score
        The estimator's own confidence, from -1e12 to 1e12; higher is better. It orders several
        instances of one object.

    Raises
    ------
    InputError
        For a name of another form, what is not a 4x4 matrix of numbers, and a score that is not a
        finite number.
    """

    object_name: str
    cam_T_obj: Float[ndarray, "4 4"]
    score: float = 1.0

    def __post_init__(self) -> None:
        name = self.object_name
        if not isinstance(name, str) or len(name) > _LONGEST_NAME or not name.isprintable():
            shown = repr(name) if len(repr(name)) < 80 else f"{repr(name)[:77]}…"
            raise InputError(
                f"Estimate: an object's name is DATASET-NUMBER, for example ycbv-5, not {shown}",
                parameters=("object_name",),
            )
        _, obj_id = split_object_name(name)
        if obj_id >= 2**31:
            raise InputError(
                f"Estimate: the number of {name} is larger than {2**31 - 1}",
                parameters=("object_name",),
            )
        refuse_unless(_FINITE, self.score, "Estimate", "score")
        object.__setattr__(self, "score", float(self.score))
        object.__setattr__(self, "cam_T_obj", as_pose(f"an estimator of {name}", self.cam_T_obj))

    def __repr__(self) -> str:
        return f"Estimate({self.object_name}, score {self.score:g})"


_ESTIMATES = mapping(sequence(a(Estimate)), "estimator")


@dataclass(frozen=True, eq=False)
class Frame:
    """All that the estimators found in one image, and what is known of the camera.

    ::

        Frame({"epos": [Estimate("ycbv-5", cam_T_a)], "gdrnpp": [Estimate("ycbv-5", cam_T_b)]})

    Attributes
    ----------
    estimates
        Estimator's name to its estimates, of any objects and any number of instances of each. An
        estimator that found nothing, or did not run, has an empty list, or is left out. A pose
        that an estimator gives an object twice is kept once, with the higher score.
    world_T_cam
        The camera's pose (OpenCV's frame, z forward) in the world, metres, (4, 4); None if it is
        not known. Without it several looks cannot be fused.
    K
        Intrinsics in pixels, (3, 3), or None; they are checked.
    time_s
        When the image was taken, seconds of any clock, or None; later looks of an episode have
        later times.
    reachable
        Names of the grasps that the robot can reach, of all objects, or of each by its name, and
        all of those that it does not name. None if all can be reached.
    repeated
        Estimator's name to the objects of which it gave a pose again, one for each repeat that was
        left out: it would be attempted twice.

    Raises
    ------
    InputError
        For what is none of these, a camera pose that is not rigid, K that is no matrix of
        intrinsics, and more than :data:`MAX_ESTIMATES` estimates or :data:`MAX_ESTIMATORS`
        estimators.
    """

    estimates: Mapping[str, Sequence[Estimate]]
    world_T_cam: Float[ndarray, "4 4"] | None = None
    K: Float[ndarray, "3 3"] | None = None
    time_s: float | None = None
    reachable: Collection[str] | Mapping[str, Collection[str]] | None = None
    repeated: Mapping[str, Sequence[str]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        refuse_unless(_ESTIMATES, self.estimates, "Frame", "estimates")
        kept = {name: tuple(given) for name, given in self.estimates.items()}
        object.__setattr__(self, "estimates", kept)
        for count, most, what in (
            (len(kept), MAX_ESTIMATORS, "estimators"),
            (len(self), MAX_ESTIMATES, "estimates"),
        ):
            if count > most:
                raise InputError(
                    f"Frame: {count} {what} are too many; at most {most} are allowed",
                    parameters=("estimates",),
                )
        self._leave_out_repeats()
        if self.time_s is not None:
            refuse_unless(_FINITE, self.time_s, "Frame", "time_s")
            object.__setattr__(self, "time_s", float(self.time_s))
        if self.world_T_cam is not None:
            object.__setattr__(self, "world_T_cam", camera_pose(self.world_T_cam, "Frame"))
        if self.K is not None:
            object.__setattr__(self, "K", intrinsics(self.K, "Frame"))
        object.__setattr__(self, "reachable", _reachable(self.reachable))

    def _leave_out_repeats(self) -> None:
        kept: dict[str, Sequence[Estimate]] = {}
        repeated: dict[str, list[str]] = {}
        for name, given in self.estimates.items():
            first: dict[tuple[str, bytes], Estimate] = {}
            for estimate in given:
                key = estimate.object_name, estimate.cam_T_obj.tobytes()
                known = first.get(key)
                # A placeholder stands for nothing found, however often it comes.
                if known is not None and not is_placeholder(estimate.cam_T_obj[None])[0]:
                    repeated.setdefault(name, []).append(estimate.object_name)
                first[key] = estimate if known is None or known.score < estimate.score else known
            kept[name] = tuple(first.values()) if name in repeated else given
        object.__setattr__(self, "estimates", kept)
        object.__setattr__(self, "repeated", repeated)

    def __len__(self) -> int:
        return sum(map(len, self.estimates.values()))

    def __repr__(self) -> str:
        names = ", ".join(self.estimates) or "no estimator"
        known = "without" if self.world_T_cam is None else "with"
        return f"Frame({counted(len(self), 'estimate')} by {names}, {known} camera pose)"

    @cached_property
    def datasets(self) -> tuple[str, ...]:
        """The datasets of the objects, sorted."""
        names = {e.object_name for found in self.estimates.values() for e in found}
        return tuple(sorted({split_object_name(name)[0] for name in names}))

    def reachable_of(self, object_name: str, known: Collection[str]) -> Collection[str]:
        """Return which of an object's known grasps can be reached."""
        if self.reachable is None:
            return known
        if isinstance(self.reachable, Mapping):
            return self.reachable.get(object_name, known)
        return [name for name in known if name in self.reachable]

    def results(self, dataset: str, estimators: Sequence[str]) -> dict[str, Results]:
        """Return the estimates of one dataset's objects as each estimator's results."""
        return {name: self._results(dataset, name) for name in estimators}

    def _results(self, dataset: str, estimator: str) -> Results:
        found = self.estimates.get(estimator, ())
        pairs = [(split_object_name(e.object_name), e) for e in found]
        mine = [(obj_id, e) for (of, obj_id), e in pairs if of == dataset]
        n = len(mine)
        zeros = np.zeros(n, dtype=np.int64)
        return Results(
            scene_id=zeros,
            im_id=zeros,
            obj_id=np.array([obj_id for obj_id, _ in mine], dtype=np.int64),
            score=np.array([e.score for _, e in mine], dtype=np.float64),
            cam_T_obj=np.array([e.cam_T_obj for _, e in mine], np.float64).reshape(-1, 4, 4),
            time_s=np.full(n, -1.0),
            line=zeros,
            source=f"estimates by {estimator}",
        )


def _reachable(given: Any) -> Any:
    if given is None:
        return None
    if isinstance(given, Mapping):
        by_object = {name: _listed(names) for name, names in given.items()}
        refuse_unless(mapping(_NAMES, "object"), by_object, "Frame", "reachable")
        return {name: tuple(names) for name, names in by_object.items()}
    given = _listed(given)
    refuse_unless(_NAMES, given, "Frame", "reachable")
    return tuple(given)


def _listed(names: Any) -> Any:
    return sorted(names, key=str) if isinstance(names, set | frozenset) else names
