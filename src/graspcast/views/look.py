"""One look: the estimates of one image, the camera's pose in the world, intrinsics and time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.results import Results
from graspcast.bop.unit_checks import camera_problem
from graspcast.errors import InputError
from graspcast.estimates.instances import split_object_name
from graspcast.io.arguments import mapping, number, refuse_unless
from graspcast.io.wording import counted
from graspcast.pose.sanity import as_pose
from graspcast.views.camera_motion import rigid

__all__ = ["Look", "camera_pose", "intrinsics"]

_ESTIMATES = mapping(
    (lambda value: isinstance(value, Results | Mapping), "Results, or a dict of poses by object"),
    "estimator",
)


@dataclass(frozen=True, eq=False)
class Look:
    """What estimators saw in one image.

    ::

        Look({"epos": {"ycbv-5": cam_T_a}, "gdrnpp": {"ycbv-5": cam_T_b}}, world_T_cam)
        Look({"epos": results_a, "gdrnpp": results_b}, world_T_cam)  # several objects, instances

    Attributes
    ----------
    estimates
        Estimator's name to its :class:`~graspcast.bop.results.Results` of the image, or to a
        mapping of ``dataset-obj_id`` to its ``cam_T_obj`` in metres, None where it found nothing.
    world_T_cam
        The camera's pose (OpenCV's frame, z forward) in the world, metres, (4, 4); None if it is
        not known: the look is then a single view.
    K
        Intrinsics in pixels, (3, 3). They are checked, and may differ between looks.
    time_s
        When it was, seconds; later looks have later times.
    seen
        What else is known of the one estimate of a single estimator, by name: ``score`` and image
        fit, each (1, 1). None where the estimates are results, which state scores.
    results
        The estimates as results.
    datasets
        Datasets that objects' names state.
    image
        scene_id and im_id of the results; None where objects were given by name.

    Raises
    ------
    InputError
        For what is no pose, no rigid camera pose or no intrinsics, and for results of several
        images.
    """

    estimates: Mapping[str, Any]
    world_T_cam: Float[ndarray, "4 4"] | None = None
    K: Float[ndarray, "3 3"] | None = None
    time_s: float | None = None
    seen: Mapping[str, Float[ndarray, "1 1"]] | None = None
    results: Mapping[str, Results] = field(init=False, default_factory=dict)
    datasets: frozenset[str] = field(init=False, default=frozenset())
    image: tuple[int, int] | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        refuse_unless(_ESTIMATES, self.estimates, "Look", "estimates")
        if self.time_s is not None:
            refuse_unless(number(-1e12, 1e12), self.time_s, "Look", "time_s")
        datasets: set[str] = set()
        images: set[tuple[int, int]] = set()
        tables = {}
        if self.seen is None and not all(isinstance(t, Results) for t in self.estimates.values()):
            object.__setattr__(self, "seen", {})
        for name, given in self.estimates.items():
            if isinstance(given, Results):
                images |= set(zip(given.scene_id.tolist(), given.im_id.tolist(), strict=True))
                tables[name] = given
            else:
                tables[name] = _by_name(name, given, datasets)
        if len(images) > 1:
            some = ", ".join(f"{scene}/{image}" for scene, image in sorted(images)[:5])
            raise InputError(
                f"a look is one image, but its results are of {len(images)} images ({some})",
                parameters=("estimates",),
            )
        object.__setattr__(self, "results", tables)
        object.__setattr__(self, "datasets", frozenset(datasets))
        object.__setattr__(self, "image", next(iter(images), None))
        if self.world_T_cam is not None:
            object.__setattr__(self, "world_T_cam", camera_pose(self.world_T_cam, "Look"))
        if self.K is not None:
            object.__setattr__(self, "K", intrinsics(self.K, "Look"))

    def __len__(self) -> int:
        return sum(map(len, self.results.values()))

    def __repr__(self) -> str:
        known = "with" if self.world_T_cam is not None else "without"
        names = ", ".join(self.estimates) or "no estimator"
        return f"Look({counted(len(self), 'estimate')} by {names}, {known} camera pose)"


def _by_name(estimator: str, poses: Mapping[Any, Any], datasets: set[str]) -> Results:
    """Return poses by object's name as results, and add the datasets."""
    numbers, rows = [], []
    for name, pose in poses.items():
        if not isinstance(name, str):
            raise InputError(
                f"Look: objects are given by name, for example ycbv-5, not {name!r}",
                parameters=("estimates",),
            )
        dataset, obj_id = split_object_name(name)
        datasets.add(dataset)
        if pose is not None:
            numbers.append(obj_id)
            rows.append(as_pose(f"{estimator} of {name}", pose))
    return _results(f"poses by {estimator}", numbers, rows)


def _results(source: str, obj_id: Iterable[int], poses: Iterable[ndarray]) -> Results:
    cam_T_obj = np.array(list(poses), dtype=np.float64).reshape(-1, 4, 4)
    n = len(cam_T_obj)
    zeros = np.zeros(n, dtype=np.int64)
    numbers = np.array(list(obj_id), dtype=np.int64)
    return Results(zeros, zeros, numbers, np.ones(n), cam_T_obj, np.full(n, -1.0), zeros, source)


def camera_pose(given: Any, where: str) -> Float[ndarray, "4 4"]:
    """Return a camera's pose, checked; ``where`` begins the message.

    Raises
    ------
    InputError
        For what is not rigid.
    """
    try:
        return rigid(given)
    except ValueError as error:
        raise InputError(
            f"{where}: the camera's pose world_T_cam {error}", parameters=("world_T_cam",)
        ) from error


def intrinsics(given: Any, where: str) -> Float[ndarray, "3 3"]:
    """Return a matrix of intrinsics, pixels, checked; ``where`` begins the message.

    Raises
    ------
    InputError
        For what cannot be one.
    """
    try:
        K = np.array(given, dtype=np.float64)
        problem = "" if K.shape == (3, 3) and np.isfinite(K).all() else "is not 3x3 finite numbers"
    except Exception:  # tensors of other libraries raise what they like
        K, problem = np.eye(3), "is not 3x3 finite numbers"
    if problem := problem or camera_problem(K):
        raise InputError(f"{where}: K {problem}", parameters=("K",))
    return K
