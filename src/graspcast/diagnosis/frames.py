"""Model frames and symmetries: what explains that sources of poses disagree, object by object."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import permutations, product

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.results import Results
from graspcast.diagnosis.case import Case
from graspcast.diagnosis.finding import Finding
from graspcast.diagnosis.offsets import Offset, find_offset, refit_shift
from graspcast.diagnosis.pairs import TRUTH, Pair
from graspcast.diagnosis.shapes import keeps_shape, surface_of
from graspcast.errors import GraspcastError
from graspcast.pose.lengths import shown
from graspcast.pose.transforms import (
    quaternion,
    rotation_angle,
    rotation_from_vector,
    rotation_vector,
    transform,
)

__all__ = ["frame_findings", "symmetry_findings"]

_LEAST = 8
_FAR, _BETTER, _LIKELY, _AGREEING = 0.12, 3.0, 1.8, 0.5
_FEW, _FAR_OF_FEW = 15, 0.3
"""In a few images of one scene, an occluded object is off in the same way by all accounts."""
_VARIETY_RAD, _BETTER_ALIKE = np.radians(15.0), 8.0
_FLIPPED_RAD, _SAME_RAD = np.radians(40.0), np.radians(15.0)
_FLIPPED, _SPUN, _ONE_AXIS = 0.33, 0.33, 0.8
_FOLDS_DEG, _FOLD_WITHIN_DEG, _SPREAD_DEG = np.array([90.0, 120.0, 180.0]), 12.0, 40.0
_LEAST_SPUN = 15
_ANGLES_RAD = np.radians([55.0, 97.0, 139.0])
_UNKNOWN_RAD = np.radians(35.0)
_SNAP_RAD, _SNAP = np.radians(7.0), 0.04


def _of(pair: Pair, obj_id: int) -> tuple[ndarray, ndarray]:
    mine = pair.obj_id == obj_id
    return pair.poses[mine], pair.others[mine]


def symmetry_findings(case: Case, pairs: Mapping[tuple[str, str], Pair]) -> Iterator[Finding]:
    """Say at which turns estimators disagree that leave the shape as it is, though unstated."""
    told: set[int] = set()
    for pair in pairs.values():
        if case.blamed & {pair.one, pair.other} or case.models is None:
            continue
        differences = pair.differences(case)
        for obj_id in np.unique(pair.obj_id).tolist():
            mine = pair.obj_id == obj_id
            if obj_id in told or obj_id not in case.models.info or mine.sum() < _LEAST:
                continue
            found = _flipped(case, obj_id, differences[mine], pair)
            if found is not None:
                told.add(obj_id)
                yield found


def _flipped(
    case: Case, obj_id: int, differences: Float[ndarray, "n 4 4"], pair: Pair
) -> Finding | None:
    """Say that many turns between two sources are one turn, or are all about one axis."""
    surface = surface_of(case.models, obj_id) if case.models is not None else None
    angle = rotation_angle(differences[:, :3, :3])
    large = angle > _FLIPPED_RAD
    if surface is None or case.models is None or large.mean() < _FLIPPED or large.sum() < 4:
        return None
    turns = differences[large, :3, :3]
    # The turn that most others are near to, or else a common axis.
    apart = rotation_angle(np.swapaxes(turns, 1, 2)[:, None] @ turns[None])
    near = (apart < _SAME_RAD).sum(axis=1)
    common = turns[int(near.argmax())]
    vectors = rotation_vector(turns)
    axes = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    weights, directions = np.linalg.eigh(axes.T @ axes / len(axes))
    folds = np.abs(np.degrees(rotation_angle(common)) - _FOLDS_DEG)
    around = np.degrees(np.abs(vectors @ directions[:, -1]))
    spun = float(np.subtract(*np.quantile(around, [0.75, 0.25]))) > _SPREAD_DEG
    if near.max() >= max(4, _FLIPPED * len(angle)) and folds.min() < _FOLD_WITHIN_DEG:
        share, tried = near.max() / len(angle), [rotation_vector(common)]
        words = f"at about {np.degrees(rotation_angle(common)):.0f}°"
    elif spun and len(angle) >= _LEAST_SPUN and weights[-1] > _ONE_AXIS and large.mean() >= _SPUN:
        share = float(large.mean())
        tried = [directions[:, -1] * a for a in _ANGLES_RAD]
        words = f"at {np.degrees(angle[large].min()):.0f}° to {np.degrees(angle.max()):.0f}°"
    else:
        return None
    if not all(keeps_shape(case.models, obj_id, _about(surface.centroid, v)) for v in tried):
        return None
    axis = tried[0] / np.linalg.norm(tried[0])
    along = ", ".join(f"{x:.2f}" for x in axis * np.sign(axis[np.argmax(np.abs(axis))]))
    return Finding(
        "error",
        "symmetry-unstated",
        f"{case.models.directory}/models_info.json",
        f"object {obj_id}: {pair.one} and {pair.other} disagree in {share:.0%} of {len(angle)} "
        f"images {words} about the axis ({along}), a turn that leaves the mesh as it is; no such "
        "symmetry is stated",
        "State the symmetry in models_info.json",
        {"object": obj_id, "share": float(share), "axis": axis.tolist()},
    )


def _about(point: ndarray, turn: ndarray) -> Float[ndarray, "4 4"]:
    R = rotation_from_vector(turn)
    return transform(R, point - R @ point)


def frame_findings(
    case: Case, sources: Mapping[str, Results], pairs: Mapping[tuple[str, str], Pair]
) -> Iterator[Finding]:
    """Say whose poses differ from others' by a constant transform of the object's frame."""
    clear: dict[int, dict[tuple[str, str], Offset]] = {}
    likely: dict[int, dict[tuple[str, str], Offset]] = {}
    compared: Counter[tuple[int, str]] = Counter()
    for key, pair in pairs.items():
        if case.blamed & set(key):
            continue
        for obj_id in np.unique(pair.obj_id).tolist():
            poses, others = _of(pair, obj_id)
            if len(poses) < _LEAST:
                continue
            compared.update((obj_id, name) for name in key)
            size = case.diameter_m(obj_id)
            size = size if np.isfinite(size) else 0.15
            offset = find_offset(poses, others, case.symmetries(obj_id), size)
            if not _explains(offset, poses, size, _LIKELY) or _symmetric(case, obj_id, offset):
                continue
            likely.setdefault(obj_id, {})[key] = offset
            if _explains(offset, poses, size, _BETTER):
                clear.setdefault(obj_id, {})[key] = offset
    overall = Counter(name for found in clear.values() for pair in found for name in pair)
    order = list(sources)
    odd: dict[int, str] = {}
    # What is clear of one object is believed of others where it is likely.
    for obj_id, found in likely.items():
        times = Counter(name for pair in clear.get(obj_id, found) for name in pair)
        if obj_id in clear or any(overall[name] for name in times):
            name = max(times, key=lambda n: (times[n], overall[n], n != TRUTH, order.index(n)))
            agreeing = sum(name in pair for pair in found)
            # A frame differs from all others; what differs from one of them alone is an error.
            if agreeing >= min(2, compared[obj_id, name]):
                odd[obj_id] = name
    offsets = {
        obj_id: {pair: o for pair, o in likely[obj_id].items() if who in pair}
        for obj_id, who in odd.items()
    }
    for name in dict.fromkeys(odd.values()):
        if overall[name]:
            objects = [obj_id for obj_id, who in odd.items() if who == name]
            yield _frame_finding(case, sources, pairs, offsets, name, objects)


def _symmetric(case: Case, obj_id: int, offset: Offset) -> bool:
    """Return whether the transform may be a symmetry; without a model every large turn may."""
    if case.models is None or obj_id not in case.models.info:
        return offset.turn_rad > _UNKNOWN_RAD
    return keeps_shape(case.models, obj_id, offset.one_T_other)


def _explains(offset: Offset, poses: ndarray, diameter_m: float, better: float) -> bool:
    """Return whether a transform explains most of a disagreement that is large."""
    views = quaternion(poses[:, :3, :3])
    mean = np.linalg.eigh(views.T @ views)[1][:, -1]
    alike = 2 * np.median(np.arccos(np.clip(np.abs(views @ mean), 0, 1))) < _VARIETY_RAD
    moved = offset.shift_m > 0.06 * diameter_m or offset.turn_rad > np.radians(12)
    return (
        offset.before > (_FAR if len(poses) >= _FEW else _FAR_OF_FEW)
        and offset.before > (_BETTER_ALIKE if alike else better) * offset.after
        and offset.agreeing > _AGREEING
        and moved
    )


def _frame_finding(
    case: Case,
    sources: Mapping[str, Results],
    pairs: Mapping[tuple[str, str], Pair],
    offsets: Mapping[int, Mapping[tuple[str, str], Offset]],
    odd: str,
    objects: list[int],
) -> Finding:
    """Word the finding of the source whose frame differs, with the repairs of all its objects."""
    repairs: dict[int, ndarray] = {}
    numbers: dict[str, object] = {}
    parts = []
    for obj_id in objects:
        repair, offset, exact = _repair(case, pairs, offsets[obj_id], odd, obj_id)
        repairs[obj_id] = repair
        shift, turn = float(np.linalg.norm(repair[:3, 3])), rotation_angle(repair[:3, :3])
        parts.append(f"{obj_id} by {shown(shift)} and {np.degrees(turn):.1f}°")
        numbers[str(obj_id)] = {
            "offset_mm": (1000 * repair[:3, 3]).tolist(),
            "turn_deg": np.degrees(rotation_vector(repair[:3, :3])).tolist(),
            "instances": offset.instances,
            "apart": offset.before,
            "apart_after": offset.after,
            "error_mm": 1000 * offset.error_m,
            "error_deg": float(np.degrees(offset.error_rad)),
            "exact": exact,
        }
    against = sorted({n for i in objects for pair in offsets[i] for n in pair} - {odd})
    best = offsets[objects[0]][next(iter(offsets[objects[0]]))]
    who = "all estimators" if odd == TRUTH and len(against) > 1 else odd
    other = "ground truth" if odd == TRUTH else " and ".join(against)
    if odd == TRUTH and len(against) == 1:
        who = against[0]
    verb = "differ" if who == "all estimators" else "differs"
    return Finding(
        "error",
        "other-model-frame",
        sources[odd].source,
        f"{who} {verb} from {other} by a constant transform of the object's frame, object "
        f"{'; '.join(parts)}: the median distance of {best.instances} poses is "
        f"{best.before:.2f} diameters, and {best.after:.2f} without it",
        "The models have other frames: apply the repair on the object's side of the estimates, "
        "cam_T_est @ repair, or use the models that the estimator used",
        numbers,
        repairs,
        "" if odd == TRUTH else odd,
    )


def _repair(
    case: Case,
    pairs: Mapping[tuple[str, str], Pair],
    found: Mapping[tuple[str, str], Offset],
    odd: str,
    obj_id: int,
) -> tuple[Float[ndarray, "4 4"], Offset, bool]:
    """Return the repair of estimates, from all pairs in which the odd one takes part."""
    poses, others = [], []
    for key in found:
        if odd not in key:
            continue
        pair = pairs[key] if key[0] == odd else pairs[key].swapped()
        mine, theirs = _of(pair, obj_id)
        # Where ground truth is the odd one, the estimates are repaired all the same.
        poses.append(theirs if odd == TRUTH else mine)
        others.append(mine if odd == TRUTH else theirs)
    a, b = np.concatenate(poses), np.concatenate(others)
    size = case.diameter_m(obj_id)
    size = size if np.isfinite(size) else 0.15
    offset = find_offset(a, b, case.symmetries(obj_id), size)
    snapped, exact = _snapped(case, obj_id, a, b, offset, size)
    return snapped, offset, exact


def _snapped(
    case: Case, obj_id: int, poses: ndarray, others: ndarray, offset: Offset, size: float
) -> tuple[Float[ndarray, "4 4"], bool]:
    """Replace a transform by the exact one of usual frames that is within its uncertainty.

    Usual frames have axes along the model's, and their origin at the model's, at the middle of its
    bounding box or of one of its sides, at the mean of its vertices or of its surface.
    """
    R = offset.one_T_other[:3, :3]
    near = min(_AXES, key=lambda Q: float(rotation_angle(Q.T @ R)))
    if rotation_angle(near.T @ R) > _SNAP_RAD:
        return offset.one_T_other, False
    shift = refit_shift(poses, others, case.symmetries(obj_id), near)
    best, apart = None, _SNAP * size
    for origin in _origins(case, obj_id):
        candidate = -near @ origin
        off = float(np.linalg.norm(candidate - shift))
        if off < apart:
            best, apart = candidate, off
    if best is None:
        return transform(near, shift), False
    return transform(near, best), True


def _proper_axes() -> list[ndarray]:
    out = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            Q = np.zeros((3, 3))
            Q[range(3), order] = signs
            if np.linalg.det(Q) > 0:
                out.append(Q)
    return out


_AXES = _proper_axes()


def _origins(case: Case, obj_id: int) -> list[Float[ndarray, "3"]]:
    if case.models is None or obj_id not in case.models.info:
        return [np.zeros(3)]
    info = case.models[obj_id]
    middle = info.lower + info.size / 2
    out = [np.zeros(3), middle]
    for axis in range(3):
        for side in (-0.5, 0.5):
            moved = middle.copy()
            moved[axis] += side * info.size[axis]
            out.append(moved)
    try:
        out.append(case.models.mesh(obj_id).vertices.mean(axis=0))
    except GraspcastError:
        return out
    surface = surface_of(case.models, obj_id)
    return [*out, surface.centroid] if surface is not None else out
