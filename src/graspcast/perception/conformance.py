"""Whether an estimator is one: the checks that any, built in or a user's own, must pass."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import Detections
from graspcast.errors import GraspcastError, InputError
from graspcast.io.conformance import Check, Report, UnmetError
from graspcast.perception.estimator import Estimator, Poses
from graspcast.pose.transforms import is_identity, project_to_rotation

__all__ = ["EstimatorReport", "check_estimator"]

_IMAGES = 3
_RIGID = 1e-6
_NEAR_M, _FAR_M = 0.05, 20.0
_SAME = 1e-6
_OFF = 0.75
"""An object's origin is seen at most so far from its box, in sides of it."""


class EstimatorReport(Report):
    """What :func:`check_estimator` found."""

    kind = "estimator"


@dataclass
class _Bench:
    """Images to try, and what the estimator said of them."""

    images: list[tuple[UInt8[ndarray, "h w 3"], Float[ndarray, "3 3"], Detections]]
    said: list[Poses] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)


def check_estimator(
    estimator: Estimator, dataset: BopDataset, detections: Detections
) -> EstimatorReport:
    """Try an estimator and report what of the protocol it keeps.

    It says what it is (``describes``); on a few images of a dataset it gives one pose and score a
    detection (``answers``), rigid and finite (``rigid``), in metres and in front of the camera
    (``metres``), where the object was detected (``place``); it says the same when asked again
    (``repeats``) and whatever the order of the detections (``order``), leaves what it is given as
    it was (``keeps``), heeds the image (``looks``) and the camera (``camera``), is content with no
    detection (``empty``), and refuses an object that it does not know with an error that says so
    (``refuses``). The time that an image takes is stated, not judged (``time``).

    Parameters
    ----------
    estimator
        For example ``built_in("dense")``, or an own one.
    dataset
        Images and cameras.
    detections
        Of some objects that the estimator knows; the images with most are used.

    Raises
    ------
    InputError
        If the detections are of no object that it knows.
    """
    checks: list[Check] = []
    bench = _Bench([])
    for name, check in _CHECKS:
        if name == "answers":
            bench.images = _images(estimator, dataset, detections)
        try:
            checks.append(Check(name, True, check(estimator, bench)))
        except (UnmetError, GraspcastError) as problem:
            checks.append(Check(name, False, str(problem)))
        except Exception as problem:  # whatever a foreign estimator raises is what is to be told
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
            f"{detections.source}: none of an object that {estimator.name} knows "
            f"({', '.join(map(str, estimator.obj_ids))})"
        )
    most = sorted(known.images().items(), key=lambda item: -len(item[1]))[:_IMAGES]
    return [(dataset.image(*key), dataset.camera_of(*key).K, seen) for key, seen in most]


def _describes(estimator: Estimator, bench: _Bench) -> str:
    wanted = ("name", "obj_ids", "estimate")
    if missing := [name for name in wanted if not hasattr(estimator, name)]:
        raise UnmetError(f"lacks {', '.join(missing)}")
    if not isinstance(estimator.name, str) or not estimator.name:
        raise UnmetError(f"its name is {estimator.name!r}; it should be a word")
    ids = tuple(estimator.obj_ids)
    if not ids or not all(isinstance(k, int | np.integer) for k in ids):
        raise UnmetError(f"obj_ids is {ids}; it should hold the numbers of the objects it knows")
    return f"knows objects {', '.join(map(str, ids))}"


def _answers(estimator: Estimator, bench: _Bench) -> str:
    for image, K, seen in bench.images:
        start = time.perf_counter()
        poses = estimator.estimate(image, K, seen)
        bench.seconds.append(time.perf_counter() - start)
        shape, scores = np.shape(poses.cam_T_obj), np.shape(poses.score)
        if shape != (len(seen), 4, 4) or scores != (len(seen),):
            raise UnmetError(
                f"for {len(seen)} detections it gave poses {shape} and scores {scores}; there "
                f"should be {(len(seen), 4, 4)} and {(len(seen),)}"
            )
        bench.said.append(poses)
    found = sum(int((~is_identity(p.cam_T_obj)).sum()) for p in bench.said)
    asked = sum(len(p.score) for p in bench.said)
    if not found:
        raise UnmetError(f"found nothing in any of {asked} detections")
    return f"{found} poses for {asked} detections in {len(bench.images)} images"


def _found(bench: _Bench) -> Float[ndarray, "n 4 4"]:
    poses = np.concatenate([p.cam_T_obj for p in bench.said])
    return poses[~is_identity(poses)]


def _rigid(estimator: Estimator, bench: _Bench) -> str:
    poses = _found(bench)
    scores = np.concatenate([p.score for p in bench.said])
    if not (np.isfinite(poses).all() and np.isfinite(scores).all()):
        raise UnmetError("a pose or a score is not finite; the identity stands for 'nothing found'")
    if scores.min() < 0 or scores.max() > 1:
        raise UnmetError(f"scores go from {scores.min():g} to {scores.max():g}, beyond 0 and 1")
    distance = np.abs(poses[:, :3, :3] - project_to_rotation(poses[:, :3, :3])).max()
    if distance > _RIGID or not (poses[:, 3] == [0, 0, 0, 1]).all():
        raise UnmetError(f"a pose is {distance:.3g} away from a rigid transform")
    return f"within {distance:.0e} of a rotation"


def _metres(estimator: Estimator, bench: _Bench) -> str:
    z = _found(bench)[:, 2, 3]
    if z.min() <= 0:
        raise UnmetError(f"an object is {z.min():.3g} m before the camera, which looks along +z")
    if not _NEAR_M < np.median(z) < _FAR_M:
        raise UnmetError(f"the median distance is {np.median(z):.4g}; are these metres?")
    return f"{z.min():.2f} to {z.max():.2f} m away"


def _place(estimator: Estimator, bench: _Bench) -> str:
    apart = []
    for (_, K, seen), poses in zip(bench.images, bench.said, strict=True):
        found = ~is_identity(poses.cam_T_obj)
        pixel = poses.cam_T_obj[found, :3, 3] @ K.T
        box = seen.box_xywh[found]
        off = np.abs(pixel[:, :2] / pixel[:, 2:] - box[:, :2] - box[:, 2:] / 2)
        apart.extend((off.max(axis=1) / box[:, 2:].max(axis=1)).tolist())
    median = float(np.median(apart))
    if median > _OFF:
        raise UnmetError(
            f"objects are seen {median:.1f} box sides away from where they were detected; is it "
            "cam_T_obj, with x right, y down and z forward, and the object's own origin?"
        )
    return f"the origin is {median:.2f} box sides from the middle of the detection (median)"


def _same(one: Poses, other: Poses) -> float:
    """The largest difference of any number."""
    apart = np.abs(one.cam_T_obj - other.cam_T_obj).max(initial=0.0)
    return float(max(apart, np.abs(one.score - other.score).max(initial=0.0)))


def _repeats(estimator: Estimator, bench: _Bench) -> str:
    for (image, K, seen), poses in zip(bench.images, bench.said, strict=True):
        if (apart := _same(estimator.estimate(image, K, seen), poses)) > _SAME:
            raise UnmetError(f"asked again it says something else, by {apart:.3g}; seed it")
    return "the same again"


def _order(estimator: Estimator, bench: _Bench) -> str:
    for (image, K, seen), poses in zip(bench.images, bench.said, strict=True):
        turned = np.arange(len(seen))[::-1]
        other = estimator.estimate(image, K, seen.select(turned))
        if (apart := _same(other, Poses(poses.cam_T_obj[turned], poses.score[turned]))) > _SAME:
            raise UnmetError(
                f"with the detections turned round, poses differ by {apart:.3g}; there should be "
                "one for each, in their order"
            )
    return "whatever the order of the detections"


def _keeps(estimator: Estimator, bench: _Bench) -> str:
    image, K, seen = bench.images[0]
    given = (image.copy(), K.copy(), replace(seen, box_xywh=seen.box_xywh.copy()))
    estimator.estimate(*given)
    for name, before, after in (
        ("image", image, given[0]),
        ("K", K, given[1]),
        ("detections", seen.box_xywh, given[2].box_xywh),
    ):
        if not np.array_equal(before, after):
            raise UnmetError(f"it changed the {name} that it was given")
    return "leaves image, camera and detections as they were"


def _looks(estimator: Estimator, bench: _Bench) -> str:
    image, K, seen = bench.images[0]
    if _same(estimator.estimate(255 - image, K, seen), bench.said[0]) <= _SAME:
        raise UnmetError("it says the same of the negative of an image; does it look at it?")
    return "another image, other poses"


def _camera(estimator: Estimator, bench: _Bench) -> str:
    image, K, seen = bench.images[0]
    longer = K * np.array([[1.5], [1.5], [1.0]])
    longer[:2, 2] = K[:2, 2]
    near, far = bench.said[0], estimator.estimate(image, longer, seen)
    both = ~is_identity(near.cam_T_obj) & ~is_identity(far.cam_T_obj)
    ratio = float(np.median(far.cam_T_obj[both, 2, 3] / near.cam_T_obj[both, 2, 3]))
    if not both.any() or not 1.2 < ratio < 1.9:
        raise UnmetError(
            f"with 1.5 times the focal length objects are {ratio:.2f} times as far away; what "
            "looks the same through a longer lens is farther away in proportion"
        )
    return f"1.5 times the focal length, {ratio:.2f} times the distance"


def _empty(estimator: Estimator, bench: _Bench) -> str:
    image, K, seen = bench.images[0]
    poses = estimator.estimate(image, K, seen.select(np.zeros(len(seen), dtype=bool)))
    if np.shape(poses.cam_T_obj) != (0, 4, 4) or np.shape(poses.score) != (0,):
        raise UnmetError(f"for no detection it gave {np.shape(poses.cam_T_obj)}, not (0, 4, 4)")
    return "no detection, no pose"


def _refuses(estimator: Estimator, bench: _Bench) -> str:
    image, K, seen = bench.images[0]
    stranger = int(max(estimator.obj_ids)) + 1
    other = replace(seen, obj_id=np.full(len(seen), stranger))
    try:
        estimator.estimate(image, K, other)
    except GraspcastError as error:
        return f"of an object that it does not know it says: {error}"
    except Exception as error:
        raise UnmetError(
            f"of object {stranger}, which it does not know, it raised "
            f"{type(error).__name__}: {error}; raise graspcast.errors.UnknownNameError"
        ) from error
    raise UnmetError(f"it gave poses of object {stranger}, which it does not know")


def _time(estimator: Estimator, bench: _Bench) -> str:
    count = np.mean([len(p.score) for p in bench.said])
    return f"{1e3 * np.median(bench.seconds):.0f} ms for an image with {count:.0f} detections"


_CHECKS: tuple[tuple[str, Callable[[Estimator, _Bench], str]], ...] = (
    ("describes", _describes),
    ("answers", _answers),
    ("rigid", _rigid),
    ("metres", _metres),
    ("place", _place),
    ("repeats", _repeats),
    ("order", _order),
    ("keeps", _keeps),
    ("looks", _looks),
    ("camera", _camera),
    ("empty", _empty),
    ("refuses", _refuses),
    ("time", _time),
)
_NEEDED = ("describes", "answers", "rigid")
