"""Checks of camera motion against the estimates of objects that stand still.

Carried by the motion, an object's estimates in two images agree to some per cent of the distance.
If they do so only after a change of unit, direction or camera convention, that is said; if nothing
makes them agree, the motion is of another scene, or the objects were moved.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.results import Results
from graspcast.errors import MismatchError
from graspcast.estimates.selection import listed
from graspcast.pose.lengths import METRES, UNIT_NAMES, shown
from graspcast.pose.transforms import compose, invert, transform_points
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
        Naming the unit, direction or convention with which they would agree; or the scenes in which
        nothing agrees.
    """
    pairs = list(_pairs(results, motion))
    if len(pairs) < _LEAST_PAIRS:
        return (
            f"{motion.source}: not compared with the estimates, since only {len(pairs)} pairs of "
            "images show the same object"
        )
    scene = np.array([pair[0] for pair in pairs])
    a, b, t_a, t_b = (np.stack([pair[i] for pair in pairs]) for i in range(1, 5))
    given = _disagreement(a, b, t_a, t_b)
    now = float(np.median(given))
    if now > _SURELY:
        source = f"{motion.source}: "
        _refuse_wrong_reading(a, b, t_a, t_b, least=_AGREE, source=source, what="image")
    wrong = [
        int(s)
        for s in np.unique(scene)
        if (scene == s).sum() >= _LEAST_PAIRS and np.median(given[scene == s]) > _DISAGREE
    ]
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
    cameras = {image for _, image in motion.world_T_cam}
    if im_id not in cameras or len(cameras) == 1:
        return ""
    if not pairs:
        return "the camera poses could not be checked: no object is in another look too"
    a, b, t_a, t_b = (np.stack([pair[i] for pair in pairs]) for i in range(1, 5))
    now = float(np.median(_disagreement(a, b, t_a, t_b)))
    if now > _DISAGREE:
        _refuse_wrong_reading(a, b, t_a, t_b, least=_SURELY, source="", what="look")
        far = float(np.median(np.linalg.norm(t_a, axis=1)))
        return (
            "the camera poses contradict the estimates: carried from look to look, positions of "
            f"objects differ by a median of {shown(now * far)}; was an object moved, or are the "
            "camera poses of another scene?"
        )
    if len({pair[0] for pair in pairs}) == 1:
        return "the camera poses were checked by one object in two looks alone"
    return ""


def _refuse_wrong_reading(
    a: Float[ndarray, "m 4 4"],
    b: Float[ndarray, "m 4 4"],
    t_a: Float[ndarray, "m 3"],
    t_b: Float[ndarray, "m 3"],
    *,
    least: float,
    source: str,
    what: str,
) -> None:
    """Raise if another reading of the camera poses makes the positions agree."""
    now = float(np.median(_disagreement(a, b, t_a, t_b)))
    found = {words: _disagreement(*read, t_a, t_b) for words, read in _readings(a, b)}
    words = min(found, key=lambda w: float(np.median(found[w])))
    best = float(np.median(found[words]))
    if best < least and best * _BETTER < now:
        far = float(np.median(np.linalg.norm(t_a, axis=1)))
        raise MismatchError(
            f"{source}the camera poses contradict the estimates: carried from {what} to {what}, "
            f"positions of objects differ by a median of {shown(now * far)}; {words}, it would be "
            f"{shown(best * far)}",
            parameters=("camera_poses", "world_T_cam"),
        )


def _pairs_with(
    results: Mapping[str, Results], motion: CameraMotion, im_id: int
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
            if other != im_id and other in cameras and len(there) == len(here) == 1:
                t_here, t_there = (table.cam_T_obj[i, :3, 3] for i in (here[0], there[0]))
                yield (obj_id, other), cameras[im_id], cameras[other], t_here, t_there


def _pairs(
    results: Mapping[str, Results], motion: CameraMotion
) -> Iterator[tuple[int, ndarray, ndarray, ndarray, ndarray]]:
    """Yield scene, camera poses and positions of objects that are alone in their images."""
    for name in sorted(results):
        table = results[name]
        keys = np.stack([table.scene_id, table.obj_id, table.im_id], axis=1)
        _, first, count = np.unique(keys, axis=0, return_index=True, return_counts=True)
        images = {
            key
            for key in zip(table.scene_id.tolist(), table.im_id.tolist(), strict=True)
            if key in motion.world_T_cam
        }
        groups: dict[tuple[int, int], list[int]] = {}
        for row in first[count == 1].tolist():
            scene_id, obj_id, im_id = keys[row].tolist()
            if (scene_id, im_id) in images:
                groups.setdefault((scene_id, obj_id), []).append(row)
        for (scene_id, _), rows in groups.items():
            # The widest gaps between images: the first half with the second.
            half = len(rows) // 2
            step = max(1, half // _PAIRS_PER_GROUP)
            for i in range(0, half, step):
                one, other = rows[i], rows[i + half]
                yield (
                    scene_id,
                    motion.world_T_cam[scene_id, int(table.im_id[one])],
                    motion.world_T_cam[scene_id, int(table.im_id[other])],
                    table.cam_T_obj[one, :3, 3],
                    table.cam_T_obj[other, :3, 3],
                )


def _disagreement(
    a: Float[ndarray, "m 4 4"],
    b: Float[ndarray, "m 4 4"],
    t_a: Float[ndarray, "m 3"],
    t_b: Float[ndarray, "m 3"],
) -> Float[ndarray, " m"]:
    """Return the distance between both positions as a share of the object's distance."""
    moved = transform_points(compose(invert(a), b), np.zeros((1, 3)))[:, 0] + np.einsum(
        "nij,nj->ni", compose(invert(a), b)[:, :3, :3], t_b
    )
    return np.asarray(np.linalg.norm(moved - t_a, axis=1) / np.linalg.norm(t_a, axis=1))


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


def _read(
    world_T_cam: Float[ndarray, "m 4 4"], inverse: bool, opengl: bool, factor: float
) -> Float[ndarray, "m 4 4"]:
    out = world_T_cam.copy()
    out[:, :3, 3] *= factor
    out = invert(out) if inverse else out
    return out @ _OPENGL if opengl else out
