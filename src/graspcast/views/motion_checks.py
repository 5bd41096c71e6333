"""Checks of camera motion against the estimates of objects that stand still.

Carried by the motion, an object's estimates in two images agree to some per cent of the distance.
If they do so only after a change of unit, direction or camera convention, that is said; if nothing
makes them agree, the motion is of another scene, or the objects were moved.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.results import Results
from graspcast.errors import MismatchError
from graspcast.estimates.selection import listed
from graspcast.io.wording import counted
from graspcast.pose.lengths import METRES, UNIT_NAMES, shown
from graspcast.pose.transforms import compose, invert
from graspcast.views.camera_motion import CameraMotion

__all__ = ["check_looks", "check_motion"]

_AGREE, _DISAGREE, _BETTER, _SURELY = 0.06, 0.12, 3.0, 0.03
"""Median disagreements as shares of the distance; how much better another reading has to be."""
_PAIRS_PER_GROUP, _LEAST_PAIRS = 40, 10
_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


def check_motion(results: Mapping[str, Results], motion: CameraMotion) -> str:
    """Raise if estimates of the static scene contradict the camera motion.

    Parameters
    ----------
    results
        Estimator's name to its results.
    motion
        The camera's poses in the same scenes.

    Returns
    -------
    A remark if there is too little to compare, or nothing.

    Raises
    ------
    MismatchError
        If no image of the estimates has a camera pose; naming the unit, direction or convention
        with which they would agree; or the scenes in which nothing agrees.
    """
    _refuse_other_images(results, motion)
    pairs = list(_pairs(results, motion))
    if len(pairs) < _LEAST_PAIRS:
        pairs += _pairs(results, motion, alone=False)
    source = f"{motion.source}: "
    if not pairs:
        return (
            f"{source}not compared with the estimates, since no two images of a scene that have a "
            "camera pose show the same object"
        )
    scene = np.array([pair[0] for pair in pairs])
    a, b, t_a, t_b = _stacked([pair[1:] for pair in pairs])
    given = _disagreement(a, b, t_a, t_b)
    now = float(np.median(given))
    if len(pairs) < _LEAST_PAIRS:
        return source + (
            _contradiction(a, b, t_a, t_b, source=source, what="image")
            or f"compared with the estimates in {counted(len(pairs), 'pair')} of images alone"
        )
    if now > _SURELY:
        _refuse_wrong_reading(a, b, t_a, t_b, least=_AGREE, source=source, what="image")
    wrong = [
        int(s)
        for s in np.unique(scene)
        if (scene == s).sum() >= _LEAST_PAIRS and np.median(given[scene == s]) > _DISAGREE
    ]
    for s in wrong:
        mine, where = scene == s, f" in scene {s}"
        _refuse_wrong_reading(
            *(x[mine] for x in (a, b, t_a, t_b)),
            least=_AGREE,
            source=source,
            what="image",
            where=where,
        )
    if wrong or now > _DISAGREE:
        where = f"in scene {listed(wrong)} " if wrong else ""
        off = float(np.median(given[np.isin(scene, wrong)])) if wrong else now
        far = float(np.median(np.linalg.norm(t_a, axis=1)))
        raise MismatchError(
            f"{motion.source}: the camera poses contradict the estimates: carried from image to "
            f"image, positions of objects {where}differ by a median of {shown(off * far)}, and no "
            "change of unit or direction mends it; are they of another scene, were objects "
            "moved between the images, or most estimates far off? Leave out the camera poses of "
            "such scenes",
            parameters=("camera_poses",),
        )
    return ""


def check_looks(results: Mapping[str, Results], motion: CameraMotion, im_id: int) -> str:
    """Raise if only another reading of the camera poses makes the estimates of a few looks agree.

    Parameters
    ----------
    results
        Estimator's name to its results, of one scene.
    motion
        The camera's poses.
    im_id
        The last look's image; every other look is compared with it.

    Returns
    -------
    A remark if they do not agree, or there is little to compare; or nothing.

    Raises
    ------
    MismatchError
        Naming the unit, direction or convention with which they would agree.
    """
    pairs = list(_pairs_with(results, motion, im_id))
    pairs = pairs or list(_pairs_with(results, motion, im_id, alone=False))
    cameras = {image for _, image in motion.world_T_cam}
    if im_id not in cameras or len(cameras) == 1:
        return ""
    if not pairs:
        return "the camera poses could not be checked: no object is in another look too"
    a, b, t_a, t_b = _stacked([pair[1:] for pair in pairs])
    if remark := _contradiction(a, b, t_a, t_b, source="", what="look"):
        return remark
    if len({pair[0] for pair in pairs}) == 1:
        return "the camera poses were checked by one object in two looks alone"
    return ""


def _refuse_other_images(results: Mapping[str, Results], motion: CameraMotion) -> None:
    """Raise if no image of the estimates has a camera pose."""
    images = sorted(
        {
            key
            for table in results.values()
            for key in zip(table.scene_id.tolist(), table.im_id.tolist(), strict=True)
        }
    )
    if images and not any(key in motion.world_T_cam for key in images):
        known = min(motion.world_T_cam, default=None)
        raise MismatchError(
            f"{motion.source}: no image of the estimates has a camera pose: the estimates are of "
            f"image {_image(images[0])} and {len(images) - 1} others, the camera poses of image "
            f"{_image(known)} and {len(motion) - 1} others (scene_id/im_id); are images numbered "
            "otherwise?",
            parameters=("camera_poses",),
        )


def _image(key: tuple[int, int] | None) -> str:
    return "none" if key is None else f"{key[0]}/{key[1]}"


def _contradiction(
    a: Float[ndarray, "m 4 4"],
    b: Float[ndarray, "m 4 4"],
    t_a: Float[ndarray, "m 3"],
    t_b: Float[ndarray, "m k 3"],
    *,
    source: str,
    what: str,
) -> str:
    """Return how a few pairs contradict the camera poses, or nothing; raise if read wrongly."""
    now = float(np.median(_disagreement(a, b, t_a, t_b)))
    if now <= _DISAGREE:
        return ""
    _refuse_wrong_reading(a, b, t_a, t_b, least=_SURELY, source=source, what=what)
    far = float(np.median(np.linalg.norm(t_a, axis=1)))
    return (
        f"the camera poses contradict the estimates: carried from {what} to {what}, positions of "
        f"objects differ by a median of {shown(now * far)}; was an object moved, or are the camera "
        "poses of another scene?"
    )


def _refuse_wrong_reading(
    a: Float[ndarray, "m 4 4"],
    b: Float[ndarray, "m 4 4"],
    t_a: Float[ndarray, "m 3"],
    t_b: Float[ndarray, "m k 3"],
    *,
    least: float,
    source: str,
    what: str,
    where: str = "",
) -> None:
    """Raise if another reading of the camera poses makes the positions agree."""
    now = float(np.median(_disagreement(a, b, t_a, t_b)))
    best, words = min(
        (float(np.median(_disagreement(*read, t_a, t_b))), words) for words, read in _readings(a, b)
    )
    if best < least and best * _BETTER < now:
        far = float(np.median(np.linalg.norm(t_a, axis=1)))
        raise MismatchError(
            f"{source}the camera poses contradict the estimates: carried from {what} to {what}, "
            f"positions of objects{where} differ by a median of {shown(now * far)}; {words}, it "
            f"would be {shown(best * far)}",
            parameters=("camera_poses", "world_T_cam"),
        )


def _pairs_with(
    results: Mapping[str, Results], motion: CameraMotion, im_id: int, *, alone: bool = True
) -> Iterator[tuple[tuple[int, int], ndarray, ndarray, ndarray, ndarray]]:
    """Yield object and image, and what :func:`_pairs` does, of every other image with this one."""
    cameras = {image: pose for (_, image), pose in motion.world_T_cam.items()}
    if im_id not in cameras:
        return
    for table in results.values():
        rows: dict[tuple[int, int], list[int]] = {}
        for row, key in enumerate(zip(table.obj_id.tolist(), table.im_id.tolist(), strict=True)):
            rows.setdefault(key, []).append(row)
        for (obj_id, other), there in rows.items():
            here = rows.get((obj_id, im_id), [])
            if other == im_id or other not in cameras or (alone and len(there) + len(here) != 2):
                continue
            for row in here:
                positions = table.cam_T_obj[row, :3, 3], table.cam_T_obj[there, :3, 3]
                yield (obj_id, other), cameras[im_id], cameras[other], *positions


def _pairs(
    results: Mapping[str, Results], motion: CameraMotion, *, alone: bool = True
) -> Iterator[tuple[int, ndarray, ndarray, ndarray, ndarray]]:
    """Yield scene, both camera poses, an object's position in one, and its positions in the other.

    Of objects that are alone in their images there is one position; of others, if these are asked
    for, there is that of every instance.
    """
    for name in sorted(results):
        table = results[name]
        groups: dict[tuple[int, int], dict[int, list[int]]] = {}
        keys = zip(
            table.scene_id.tolist(), table.obj_id.tolist(), table.im_id.tolist(), strict=True
        )
        for row, (scene_id, obj_id, im_id) in enumerate(keys):
            if (scene_id, im_id) in motion.world_T_cam:
                groups.setdefault((scene_id, obj_id), {}).setdefault(im_id, []).append(row)
        for (scene_id, _), by_image in sorted(groups.items()):
            images = [i for i in sorted(by_image) if (len(by_image[i]) == 1) or not alone]
            if not alone and all(len(by_image[i]) == 1 for i in images):
                continue
            # The widest gaps between images: the first half with the second.
            half = len(images) // 2
            step = max(1, half // _PAIRS_PER_GROUP)
            for i in range(0, half, step):
                one, other = images[i], images[i + half]
                for row in by_image[one]:
                    yield (
                        scene_id,
                        motion.world_T_cam[scene_id, one],
                        motion.world_T_cam[scene_id, other],
                        table.cam_T_obj[row, :3, 3],
                        table.cam_T_obj[by_image[other], :3, 3],
                    )


def _stacked(
    pairs: Sequence[tuple[ndarray, ndarray, ndarray, ndarray]],
) -> tuple[
    Float[ndarray, "m 4 4"], Float[ndarray, "m 4 4"], Float[ndarray, "m 3"], Float[ndarray, "m k 3"]
]:
    """Return pairs as arrays; where an image has fewer instances, the first is repeated."""
    a, b, t_a = (np.stack([pair[i] for pair in pairs]) for i in range(3))
    most = max(len(pair[3]) for pair in pairs)
    t_b = [np.concatenate([t, np.repeat(t[:1], most - len(t), axis=0)]) for _, _, _, t in pairs]
    return a, b, t_a, np.stack(t_b)


def _disagreement(
    a: Float[ndarray, "m 4 4"],
    b: Float[ndarray, "m 4 4"],
    t_a: Float[ndarray, "m 3"],
    t_b: Float[ndarray, "m k 3"],
) -> Float[ndarray, " m"]:
    """Return the distance to the nearest carried position as a share of the object's distance."""
    a_T_b = compose(invert(a), b)
    moved = np.einsum("nij,nkj->nki", a_T_b[:, :3, :3], t_b) + a_T_b[:, None, :3, 3]
    nearest = np.linalg.norm(moved - t_a[:, None], axis=2).min(axis=1)
    return np.asarray(nearest / np.linalg.norm(t_a, axis=1))


def _readings(
    a: Float[ndarray, "m 4 4"], b: Float[ndarray, "m 4 4"]
) -> Iterator[tuple[str, tuple[ndarray, ndarray]]]:
    """Yield other readings of the camera poses, in words, with both poses read so."""
    factors: dict[float, str] = {}
    for meant in METRES:
        for read in METRES:
            factor = METRES[meant] / METRES[read]
            words = f"with translations in {UNIT_NAMES[meant]} instead of {UNIT_NAMES[read]}"
            if not any(np.isclose(factor, known) for known in (*factors, 1.0)):
                factors[factor] = words
    factors[1.0] = ""
    for inverse in (False, True):
        for opengl in (False, True):
            for factor, unit in factors.items():
                if not inverse and not opengl and factor == 1.0:
                    continue
                says = [
                    "read in the other direction (cam_T_world, w2c, and world_T_cam, c2w, "
                    "exchanged)"
                    if inverse
                    else "",
                    "with cameras that look along -z (OpenGL's convention)" if opengl else "",
                    unit,
                ]
                yield (
                    " and ".join(filter(None, says)),
                    (_read(a, inverse, opengl, factor), _read(b, inverse, opengl, factor)),
                )
    # A rotation of one direction with the translation of the other.
    words = "with each rotation transposed and translations as they are"
    yield words, (_transposed(a), _transposed(b))
    yield words, (invert(_transposed(invert(a))), invert(_transposed(invert(b))))


def _read(
    world_T_cam: Float[ndarray, "m 4 4"], inverse: bool, opengl: bool, factor: float
) -> Float[ndarray, "m 4 4"]:
    out = world_T_cam.copy()
    out[:, :3, 3] *= factor
    out = invert(out) if inverse else out
    return out @ _OPENGL if opengl else out


def _transposed(pose: Float[ndarray, "m 4 4"]) -> Float[ndarray, "m 4 4"]:
    out = pose.copy()
    out[:, :3, :3] = pose[:, :3, :3].transpose(0, 2, 1)
    return out
