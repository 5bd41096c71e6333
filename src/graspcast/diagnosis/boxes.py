"""Boxes against projected models: wrong cameras, other forms of boxes, mirrored meshes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.true_pose_checks import check_outlines
from graspcast.diagnosis.case import Case, Scenes
from graspcast.diagnosis.finding import Finding
from graspcast.diagnosis.projection import (
    Fit,
    Seen,
    fit_camera,
    outline_points,
    rays_of,
    spread,
)

__all__ = ["box_findings"]

_MOST = 600
_LEAST = 8
_VISIBLE = 0.1
_FITS, _BETTER = 0.12, 2.5
"""Median distance of box edges, by the box, of what fits; how much better another reading is."""
_MIRRORED, _EXACT = 2.0, 0.04
_UNIT_FACTORS = {"centimetres": 10.0, "metres": 1000.0, "inches": 25.4}

_FORMS: Mapping[str, tuple[Callable[[ndarray], ndarray], str, str]] = {
    "boxes-corners": (
        lambda b: b,
        "two corners (left, top, right, bottom)",
        "Write x, y, width, height: subtract the first corner from the second",
    ),
    "boxes-centre": (
        lambda b: np.concatenate([b[:, :2] - b[:, 2:] / 2, b[:, :2] + b[:, 2:] / 2], axis=1),
        "centre, width and height",
        "Write x, y, width, height: subtract half the size from the centre",
    ),
    "boxes-swapped": (
        lambda b: np.concatenate([b[:, [1, 0]], b[:, [1, 0]] + b[:, [3, 2]]], axis=1),
        "y, x, height, width",
        "Write x, y, width, height",
    ),
    "boxes-swapped-corners": (
        lambda b: b[:, [1, 0, 3, 2]],
        "two corners with y before x (top, left, bottom, right)",
        "Write x, y, width, height",
    ),
}


def box_findings(case: Case) -> Iterator[Finding]:
    """Compare all boxes with the models projected by true poses, else by estimated ones."""
    if case.models is None:
        return
    blamed_camera = False
    for scenes in case.truths:
        seen, form = _of_truth(case, scenes)
        if seen is None or form is None:
            continue
        found = list(_compared(seen, form, str(scenes.path), scenes))
        blamed_camera |= any(f.code.startswith("camera") for f in found)
        yield from found
        if not found:
            yield from _outlines(case, scenes)
            yield from _mirrored(case, scenes, seen)
    for table in case.detections:
        if blamed_camera:
            continue
        for scenes in case.scenes:
            seen, form = _of_detections(
                case, scenes, table.scene_id, table.im_id, table.obj_id, table.box_xywh
            )
            if seen is not None and form is not None:
                yield from _compared(seen, form, table.source, scenes)
                break


def _seen(
    case: Case,
    scenes: Scenes,
    keys: ndarray,
    poses: Float[ndarray, "n 4 4"],
    raw: Float[ndarray, "n 4"],
    shape: Callable[[ndarray], ndarray] | None = None,
) -> tuple[Seen | None, ndarray | None]:
    """Return boxes with projections, of instances with camera and mesh, and the boxes as given."""
    if case.models is None:
        return None, None
    step = max(1, len(keys) // _MOST)
    keys, poses, raw = keys[::step], poses[::step], raw[::step]
    cameras = [scenes.camera(s, i) for s, i in keys[:, :2].tolist()]
    rays = np.full((len(keys), 4), np.nan)
    for obj_id in np.unique(keys[:, 2]).tolist():
        mine = keys[:, 2] == obj_id
        points = outline_points(case.models, obj_id) if obj_id in case.models.info else None
        if points is not None:
            points = points if shape is None else shape(points)
            rays[mine] = rays_of(points, poses[mine])
    good = np.isfinite(rays).all(axis=1) & np.isfinite(raw).all(axis=1)
    good &= (raw[:, 2:] > 0).all(axis=1) & np.array([c is not None for c in cameras], dtype=bool)
    if int(good.sum()) < _LEAST:
        return None, None
    K = np.stack([cameras[i].K for i in np.flatnonzero(good)])  # type: ignore[union-attr]
    raw = raw[good]
    box = np.concatenate([raw[:, :2], raw[:, :2] + raw[:, 2:]], axis=1)
    return Seen(keys[good, 2], rays[good], box, K), raw


def _of_truth(
    case: Case, scenes: Scenes, shape: Callable[[ndarray], ndarray] | None = None
) -> tuple[Seen | None, ndarray | None]:
    truth = scenes.truth
    if truth is None or truth.box_xywh is None:
        return None, None
    keys = np.stack([truth.scene_id, truth.im_id, truth.obj_id], axis=1)
    rows = ~(truth.visib_fract < _VISIBLE)
    return _seen(case, scenes, keys[rows], truth.cam_T_obj[rows], truth.box_xywh[rows], shape)


def _of_detections(
    case: Case, scenes: Scenes, scene_id: ndarray, im_id: ndarray, obj_id: ndarray, raw: ndarray
) -> tuple[Seen | None, ndarray | None]:
    """Pair detections with poses of the only instance of their object in the image."""
    sources = [scenes.truth] if scenes.truth is not None else list(case.sound.values())
    for source in sources:
        poses: dict[tuple[int, int, int], list[int]] = {}
        columns = (source.scene_id.tolist(), source.im_id.tolist(), source.obj_id.tolist())
        for row, key in enumerate(zip(*columns, strict=True)):
            poses.setdefault(key, []).append(row)
        keys = np.stack([scene_id, im_id, obj_id], axis=1)
        _, first, count = np.unique(keys, axis=0, return_index=True, return_counts=True)
        rows = [
            i
            for i, n in zip(first.tolist(), count.tolist(), strict=True)
            if n == 1 and len(poses.get(tuple(keys[i].tolist()), [])) == 1
        ]
        if len(rows) >= _LEAST:
            of = [poses[tuple(keys[i].tolist())][0] for i in rows]
            return _seen(case, scenes, keys[rows], source.cam_T_obj[of], raw[rows])
    return None, None


def _compared(seen: Seen, raw: ndarray, path: str, scenes: Scenes) -> Iterator[Finding]:
    """Say how boxes and projections contradict each other."""
    edges = seen.edges()
    now = spread(edges, seen)
    if now <= _FITS:
        yield from _offset(seen, path, now, scenes)
        return
    forms = {code: spread(edges, seen, form(raw)) for code, (form, _, _) in _FORMS.items()}
    best = min(forms, key=lambda code: forms[code])
    fit = fit_camera(seen)
    fitted = spread(_edges_by(seen, fit), seen)
    if forms[best] < min(now / _BETTER, _FITS) and forms[best] <= 1.5 * fitted + 0.02:
        _, words, cure = _FORMS[best]
        yield Finding(
            "error",
            best,
            path,
            f"the edges of {len(seen)} boxes lie a median of {now:.0%} of the box from those of "
            f"the projected models; read as {words}, {forms[best]:.1%}",
            cure,
            {"boxes": len(seen), "apart": now, "apart_after": forms[best]},
        )
        return
    yield from _other_camera(seen, fit, now, fitted, path, scenes)


def _edges_by(seen: Seen, fit: Fit) -> ndarray:
    return seen.rays * [fit.fx, fit.fy, fit.fx, fit.fy] + [fit.cx, fit.cy, fit.cx, fit.cy]


def _offset(seen: Seen, path: str, now: float, scenes: Scenes) -> Iterator[Finding]:
    """Say that a camera near the given one fits clearly better."""
    fit = fit_camera(seen)
    fitted = spread(_edges_by(seen, fit), seen)
    if now > 0.05 and fitted < now / _BETTER:
        yield from _other_camera(seen, fit, now, fitted, path, scenes)


def _other_camera(
    seen: Seen, fit: Fit, now: float, fitted: float, path: str, scenes: Scenes
) -> Iterator[Finding]:
    K = np.median(seen.K, axis=0)
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    numbers = {
        "boxes": len(seen),
        "apart": now,
        "apart_after": fitted,
        "given": [fx, fy, cx, cy],
        "fitted": [fit.fx, fit.fy, fit.cx, fit.cy],
    }
    evidence = (
        f"the edges of {len(seen)} boxes lie a median of {now:.0%} of the box from those of the "
        f"projected models"
    )
    if not fitted < min(now / 2, _FITS):
        yield from _scaled_models(seen, evidence, path, numbers)
        return
    said = (
        f"{evidence}, and {fitted:.1%} by a camera with fx {fit.fx:.0f}, fy {fit.fy:.0f}, "
        f"cx {fit.cx:.0f}, cy {fit.cy:.0f} (given: {fx:.0f}, {fy:.0f}, {cx:.0f}, {cy:.0f})"
    )
    scales = np.array([fit.fx / fx, fit.fy / fy, fit.cx / cx, fit.cy / cy])
    alike = np.ptp(scales) < 0.12 * scales.mean() and abs(scales.mean() - 1) > 0.08
    if alike:
        size = scenes.dataset.image_size or (0, 0)
        by_given = abs(2 * cx - size[0]) if size[0] else 0.0
        by_fit = abs(2 * fit.cx - size[0]) if size[0] else 1.0
        ratio = float(scales.mean())
        if by_given <= by_fit:
            yield Finding(
                "error",
                "boxes-other-size",
                path,
                f"{said}: the boxes are of images {ratio:.3g} times as large",
                f"Divide the boxes by {ratio:.3g}",
                {**numbers, "ratio": ratio},
            )
        else:
            yield Finding(
                "error",
                "camera-other-size",
                _camera_file(scenes),
                f"{said}: the camera is of images {1 / ratio:.3g} times as large",
                f"Multiply fx, fy, cx and cy by {ratio:.3g}",
                {**numbers, "ratio": ratio},
            )
        return
    yield Finding(
        "error",
        "camera-wrong",
        _camera_file(scenes),
        said,
        "Write the K with which the images were taken",
        numbers,
    )


def _camera_file(scenes: Scenes) -> str:
    own = sorted(scenes.path.glob("*/scene_camera.json"))
    return str(own[0] if own else scenes.dataset.root / "camera.json")


def _scaled_models(
    seen: Seen, evidence: str, path: str, numbers: Mapping[str, object]
) -> Iterator[Finding]:
    """Say that objects look larger or smaller than their boxes by the factor of a unit."""
    edges = seen.edges()
    ours = np.maximum(*(edges[:, 2:] - edges[:, :2]).T)
    ratio = float(np.median(seen.sizes() / np.maximum(ours, 1e-9)))
    for unit, factor in _UNIT_FACTORS.items():
        for value in (factor, 1 / factor):
            if 0.75 < ratio / value < 1.33:
                yield Finding(
                    "error",
                    "models-unit",
                    path,
                    f"{evidence}: they look {ratio:.3g} times as large as the models, as models "
                    f"in {unit} would",
                    "Convert models_info.json and the meshes to millimetres",
                    {**numbers, "ratio": ratio},
                )
                return
    yield Finding(
        "warning",
        "boxes-contradict",
        path,
        f"{evidence}; no other form of boxes and no other camera makes them fit",
        "Are boxes and poses of the same images, and the models those that were annotated?",
        numbers,
    )


def _outlines(case: Case, scenes: Scenes) -> Iterator[Finding]:
    """Hold depths against the sizes of boxes, as every verb does."""
    truth = scenes.truth
    if truth is None or truth.box_xywh is None or case.models is None:
        return
    count = len(case.findings)
    boxes, models = truth.box_xywh, case.models

    def focal(scene_id: int, im_id: int) -> float:
        camera = scenes.camera(scene_id, im_id)
        return float("nan") if camera is None else float(camera.K[0, 0])

    case.attempt(
        "truth",
        scenes.path,
        lambda: check_outlines(
            truth.source,
            np.stack([truth.scene_id, truth.im_id, truth.obj_id], axis=1),
            truth.cam_T_obj[:, 2, 3],
            truth.visib_fract,
            boxes,
            diameters_m={i: m.diameter_m for i, m in models.info.items()},
            focal_px=focal,
        ),
    )
    yield from case.findings[count:]
    del case.findings[count:]


def _mirrored(case: Case, scenes: Scenes, seen: Seen) -> Iterator[Finding]:
    """Say which meshes fit their boxes when they are mirrored."""
    plain = _by_object(seen)
    for axis, name in enumerate("xyz"):
        sign = np.ones(3)
        sign[axis] = -1.0

        def flip(points: ndarray, sign: ndarray = sign) -> ndarray:
            return points * sign

        other, _ = _of_truth(case, scenes, flip)
        if other is None:
            continue
        mirrored = _by_object(other)
        found = [
            i
            for i in plain
            if i in mirrored
            and mirrored[i] < _EXACT
            and plain[i] > _MIRRORED * mirrored[i]
            and plain[i] > _EXACT / 2
        ]
        for obj_id in found:
            yield Finding(
                "error",
                "mesh-mirrored",
                f"{case.models.directory}/obj_{obj_id:06d}.ply"
                if case.models
                else str(scenes.path),
                f"the projected mesh lies a median of {plain[obj_id]:.1%} of the box from its "
                f"boxes, and {mirrored[obj_id]:.1%} when it is mirrored in {name}",
                f"Change the sign of the vertices' {name}, and turn the faces round",
                {"apart": plain[obj_id], "apart_after": mirrored[obj_id], "axis": name},
            )
        if found:
            return


def _by_object(seen: Seen) -> dict[int, float]:
    """Return each object's median distance of edges from its boxes."""
    apart = np.abs(seen.edges() - seen.box).max(axis=1) / seen.sizes()
    return {
        i: float(np.median(apart[seen.obj_id == i]))
        for i in np.unique(seen.obj_id).tolist()
        if (seen.obj_id == i).sum() >= _LEAST
    }
