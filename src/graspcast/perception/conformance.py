"""Conformance tests of the estimator interface, for built-in and user-defined estimators."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import Detections
from graspcast.errors import GraspcastError, InputError
from graspcast.io.arguments import a, checked
from graspcast.io.conformance import Check, Report, UnmetError
from graspcast.perception.estimator import Estimator, Poses
from graspcast.pose.conventions import CONVENTIONS
from graspcast.pose.sanity import is_placeholder, pose_problems

__all__ = ["EstimatorReport", "check_estimator"]

_IMAGES = 3
_SAME = 1e-6
_MAX_OFFSET = 0.75
"""Largest distance of an object's origin from the centre of its box, in sides of the box."""


class EstimatorReport(Report):
    """The report of :func:`check_estimator`."""

    kind = "estimator"


@dataclass
class _Trials:
    """Test images with camera and detections, and the estimator's outputs for them."""

    diameter_m: dict[int, float]
    images: list[tuple[UInt8[ndarray, "h w 3"], Float[ndarray, "3 3"], Detections]] = field(
        default_factory=list
    )
    outputs: list[Poses] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)


@checked(dataset=a(BopDataset), detections=a(Detections))
def check_estimator(
    estimator: Estimator, dataset: BopDataset, detections: Detections
) -> EstimatorReport:
    """Check whether an estimator conforms to the interface :class:`Estimator`.

    The checks run on a few images of a dataset:

    - ``attributes``: it has a name, object ids and the method ``estimate``;
    - ``output``: one pose and one score per detection;
    - ``rigid``: finite scores from 0 to 1; rigid transforms, in front of the camera;
    - ``metres``: no pose is too near or too far for the object's size, so that they are in metres
      (both by :func:`graspcast.pose.sanity.pose_problems`, as everywhere);
    - ``position``: objects are where they were detected;
    - ``deterministic``: the same input gives the same output;
    - ``order``: the order of the detections does not matter;
    - ``inputs_unchanged``: the arrays passed to it are not modified;
    - ``uses_image``, ``uses_camera``: the output depends on the image and on the intrinsics;
    - ``no_detections``: an image without detections gives no poses;
    - ``unknown_object``: an object that it does not know raises a GraspcastError;
    - ``time``: the run time per image, for information.

    Parameters
    ----------
    estimator
        For example ``built_in("dense")``, or your own.
    dataset
        The dataset of the images.
    detections
        Detections of objects that the estimator knows; the images with most of them are used.

    Returns
    -------
    The report; ``str(report)`` has one line per check.

    Raises
    ------
    InputError
        If the estimator knows none of the detected objects.
    """
    checks: list[Check] = []
    trials = _Trials({number: known.diameter_m for number, known in dataset.models.info.items()})
    for name, check in _CHECKS:
        if name == "output":
            trials.images = _images(estimator, dataset, detections)
        try:
            checks.append(Check(name, True, check(estimator, trials)))
        except (UnmetError, GraspcastError) as problem:
            checks.append(Check(name, False, str(problem)))
        except Exception as problem:  # the estimator may raise anything
            checks.append(Check(name, False, f"raised {type(problem).__name__}: {problem}"))
        if not checks[-1].passed and name in _NEEDED:
            break
    return EstimatorReport(str(getattr(estimator, "name", estimator)), tuple(checks))


def _images(
    estimator: Estimator, dataset: BopDataset, detections: Detections
) -> list[tuple[UInt8[ndarray, "h w 3"], Float[ndarray, "3 3"], Detections]]:
    known = detections.select(np.isin(detections.obj_id, estimator.obj_ids))
    if not len(known):
        raise InputError(
            f"{detections.source}: no detection of an object that {estimator.name} knows "
            f"({', '.join(map(str, estimator.obj_ids))})"
        )
    most = sorted(known.images().items(), key=lambda item: -len(item[1]))[:_IMAGES]
    return [(dataset.image(*key), dataset.camera_of(*key).K, seen) for key, seen in most]


def _attributes(estimator: Estimator, trials: _Trials) -> str:
    wanted = ("name", "obj_ids", "estimate")
    if missing := [name for name in wanted if not hasattr(estimator, name)]:
        raise UnmetError(f"lacks {', '.join(missing)}")
    if not isinstance(estimator.name, str) or not estimator.name:
        raise UnmetError(f"its name is {estimator.name!r}; it should be text")
    ids = tuple(estimator.obj_ids)
    if not ids or not all(isinstance(k, int | np.integer) for k in ids):
        raise UnmetError(f"obj_ids is {ids}; it should hold BOP ids of objects")
    return f"knows objects {', '.join(map(str, ids))}"


def _output(estimator: Estimator, trials: _Trials) -> str:
    for image, K, seen in trials.images:
        start = time.perf_counter()
        poses = estimator.estimate(image, K, seen)
        trials.seconds.append(time.perf_counter() - start)
        shape, scores = np.shape(poses.cam_T_obj), np.shape(poses.score)
        if shape != (len(seen), 4, 4) or scores != (len(seen),):
            raise UnmetError(
                f"for {len(seen)} detections it returned poses of shape {shape} and scores of "
                f"shape {scores}; expected {(len(seen), 4, 4)} and {(len(seen),)}"
            )
        trials.outputs.append(poses)
    found = sum(int((~is_placeholder(p.cam_T_obj)).sum()) for p in trials.outputs)
    asked = sum(len(p.score) for p in trials.outputs)
    if not found:
        raise UnmetError(f"found nothing in any of {asked} detections")
    return f"{found} poses for {asked} detections in {len(trials.images)} images"


def _found(trials: _Trials) -> tuple[Float[ndarray, "n 4 4"], Float[ndarray, " n"]]:
    """Return all poses, and the diameters of their objects."""
    poses = np.concatenate([p.cam_T_obj for p in trials.outputs]).astype(np.float64)
    numbers = np.concatenate([seen.obj_id for _, _, seen in trials.images]).tolist()
    diameter_m = np.array([trials.diameter_m.get(number, np.nan) for number in numbers])
    found = ~is_placeholder(poses)
    return poses[found], diameter_m[found]


def _refuse_problems(problems: list[str], hint: str = "") -> None:
    """Fail if there are any, with the most common one."""
    if said := Counter(problem for problem in problems if problem):
        raise UnmetError(
            f"{said.total()} of {len(problems)} poses cannot be: one {said.most_common(1)[0][0]}"
            f"{hint}"
        )


def _rigid(estimator: Estimator, trials: _Trials) -> str:
    scores = np.concatenate([p.score for p in trials.outputs])
    if not np.isfinite(scores).all():
        raise UnmetError("a score is not finite; for 'nothing found' return the identity and 0")
    if scores.min() < 0 or scores.max() > 1:
        raise UnmetError(f"scores range from {scores.min():g} to {scores.max():g}; expected 0 to 1")
    poses, _ = _found(trials)
    # Distances ("is … m away") are the next check's.
    problems = ["" if text.startswith("is ") else text for text in pose_problems(poses)]
    behind = any("behind the camera" in problem for problem in problems)
    _refuse_problems(problems, f"; {where}" if behind and (where := _where(trials)) else "")
    return f"{len(poses)} poses are rigid transforms, in front of the camera"


def _metres(estimator: Estimator, trials: _Trials) -> str:
    poses, diameter_m = _found(trials)
    _refuse_problems(pose_problems(poses, diameter_m))
    z = poses[:, 2, 3]
    return f"{z.min():.2f} to {z.max():.2f} m away"


def _offset(trials: _Trials, change: Callable[[ndarray], ndarray]) -> float:
    """Return how far origins of changed poses are from their boxes' centres, in sides (median)."""
    offsets = []
    for (_, K, seen), poses in zip(trials.images, trials.outputs, strict=True):
        found = ~is_placeholder(poses.cam_T_obj)
        pixel = change(poses.cam_T_obj[found])[:, :3, 3] @ K.T
        box = seen.box_xywh[found]
        depth = np.where(pixel[:, 2:] > 0, pixel[:, 2:], np.nan)  # nothing is seen behind
        off = np.abs(pixel[:, :2] / depth - box[:, :2] - box[:, 2:] / 2)
        offsets.extend((off.max(axis=1) / box[:, 2:].max(axis=1)).tolist())
    return float(np.median(np.nan_to_num(offsets, nan=np.inf)))


def _where(trials: _Trials) -> str:
    """Name the convention in which the poses are where their objects were detected, if any."""
    changed = [(_offset(trials, other.undo), other) for other in CONVENTIONS]
    least, convention = min(changed, key=lambda pair: pair[0])
    if least > _MAX_OFFSET:
        return ""
    return f"they are where they were detected when {convention.change}: {convention.question}"


def _position(estimator: Estimator, trials: _Trials) -> str:
    median = _offset(trials, lambda poses: poses)
    if median > _MAX_OFFSET:
        usual = "is it cam_T_obj, with x right, y down and z forward, and of the object?"
        raise UnmetError(
            f"objects are {median:.1f} box sides away from their detections; "
            f"{_where(trials) or usual}"
        )
    return f"origins are {median:.2f} box sides from the centres of the detections (median)"


def _difference(one: Poses, other: Poses) -> float:
    """Return the largest absolute difference of any number."""
    difference = np.abs(one.cam_T_obj - other.cam_T_obj).max(initial=0.0)
    return float(max(difference, np.abs(one.score - other.score).max(initial=0.0)))


def _deterministic(estimator: Estimator, trials: _Trials) -> str:
    for (image, K, seen), poses in zip(trials.images, trials.outputs, strict=True):
        if (difference := _difference(estimator.estimate(image, K, seen), poses)) > _SAME:
            raise UnmetError(f"a second call differs by {difference:.3g}; seed its random numbers")
    return "a second call gives the same"


def _order(estimator: Estimator, trials: _Trials) -> str:
    for (image, K, seen), poses in zip(trials.images, trials.outputs, strict=True):
        reverse = np.arange(len(seen))[::-1]
        other = estimator.estimate(image, K, seen.select(reverse))
        expected = Poses(poses.cam_T_obj[reverse], poses.score[reverse])
        if (difference := _difference(other, expected)) > _SAME:
            raise UnmetError(
                f"with the detections in reverse order, poses differ by {difference:.3g}; return "
                "one per detection, in their order"
            )
    return "reversed detections give the same"


def _inputs_unchanged(estimator: Estimator, trials: _Trials) -> str:
    image, K, seen = trials.images[0]
    given = (image.copy(), K.copy(), replace(seen, box_xywh=seen.box_xywh.copy()))
    estimator.estimate(*given)
    for name, before, after in (
        ("image", image, given[0]),
        ("K", K, given[1]),
        ("detections", seen.box_xywh, given[2].box_xywh),
    ):
        if not np.array_equal(before, after):
            raise UnmetError(f"it modified the {name} passed to it")
    return "image, camera and detections are not modified"


def _uses_image(estimator: Estimator, trials: _Trials) -> str:
    image, K, seen = trials.images[0]
    if _difference(estimator.estimate(255 - image, K, seen), trials.outputs[0]) <= _SAME:
        raise UnmetError("the negative of an image gives the same poses; is the image used?")
    return "another image gives other poses"


def _uses_camera(estimator: Estimator, trials: _Trials) -> str:
    image, K, seen = trials.images[0]
    longer = K * np.array([[1.5], [1.5], [1.0]])
    longer[:2, 2] = K[:2, 2]
    near, far = trials.outputs[0], estimator.estimate(image, longer, seen)
    both = ~is_placeholder(near.cam_T_obj) & ~is_placeholder(far.cam_T_obj)
    ratio = float(np.median(far.cam_T_obj[both, 2, 3] / near.cam_T_obj[both, 2, 3]))
    if not both.any() or not 1.2 < ratio < 1.9:
        raise UnmetError(
            f"with 1.5 times the focal length objects are {ratio:.2f} times as far away; expected "
            "about 1.5 times, since their size in the image is the same"
        )
    return f"1.5 times the focal length, {ratio:.2f} times the distance"


def _no_detections(estimator: Estimator, trials: _Trials) -> str:
    image, K, seen = trials.images[0]
    poses = estimator.estimate(image, K, seen.select(np.zeros(len(seen), dtype=bool)))
    if np.shape(poses.cam_T_obj) != (0, 4, 4) or np.shape(poses.score) != (0,):
        raise UnmetError(
            f"without detections it returned {np.shape(poses.cam_T_obj)}, not (0, 4, 4)"
        )
    return "no detections give no poses"


def _unknown_object(estimator: Estimator, trials: _Trials) -> str:
    image, K, seen = trials.images[0]
    unknown = int(max(estimator.obj_ids)) + 1
    other = replace(seen, obj_id=np.full(len(seen), unknown))
    try:
        estimator.estimate(image, K, other)
    except GraspcastError as error:
        return f"an unknown object raises: {error}"
    except Exception as error:
        raise UnmetError(
            f"object {unknown}, which it does not know, raised {type(error).__name__}: {error}; "
            "raise graspcast.errors.UnknownNameError"
        ) from error
    raise UnmetError(f"it returned poses of object {unknown}, which it does not know")


def _time(estimator: Estimator, trials: _Trials) -> str:
    count = np.mean([len(p.score) for p in trials.outputs])
    return f"{1e3 * np.median(trials.seconds):.0f} ms for an image with {count:.0f} detections"


_CHECKS: tuple[tuple[str, Callable[[Estimator, _Trials], str]], ...] = (
    ("attributes", _attributes),
    ("output", _output),
    ("rigid", _rigid),
    ("metres", _metres),
    ("position", _position),
    ("deterministic", _deterministic),
    ("order", _order),
    ("inputs_unchanged", _inputs_unchanged),
    ("uses_image", _uses_image),
    ("uses_camera", _uses_camera),
    ("no_detections", _no_detections),
    ("unknown_object", _unknown_object),
    ("time", _time),
)
_NEEDED = ("attributes", "output", "rigid")
